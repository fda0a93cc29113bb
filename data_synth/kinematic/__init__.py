"""Lines and impact trains determined by the shaft angles."""

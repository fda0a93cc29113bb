"""Lines and impact trains that follow from the angle of the shafts."""

"""A line whose order slips, as that of a bearing does: found, and followed."""

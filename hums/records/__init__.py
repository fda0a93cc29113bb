"""Records: their contents, checks and files."""

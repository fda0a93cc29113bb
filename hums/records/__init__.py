"""Records: contents, validation and files."""

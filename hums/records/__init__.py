"""What a record is, its checks, and its files."""

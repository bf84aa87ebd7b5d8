"""What commands show and write: the console, progress, plain lines, and files."""

"""Output of commands: the console, progress, plain lines, and files."""

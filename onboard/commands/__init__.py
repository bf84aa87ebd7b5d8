"""The command line: `cli` has the parser, and every command a file of its own."""

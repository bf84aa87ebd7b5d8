"""The live view: a client of the published records."""

"""The scenarios: their records and files, and the daemon's configuration for each."""

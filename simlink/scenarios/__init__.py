"""Scenarios: their records, their files, and the daemon's configuration for each."""

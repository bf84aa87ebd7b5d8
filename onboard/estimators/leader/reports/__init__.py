"""Broadcasts, ranges and an earlier run's estimate, made ready for the filter."""

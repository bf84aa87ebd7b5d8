"""What others say of the leader, made ready for the filter: its own broadcast, ranges, an earlier run."""

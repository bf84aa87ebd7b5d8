"""The study of the leader's estimate from any side, with default settings; `study` runs it."""

"""The study of the quality of traffic tracks; `study` runs it."""

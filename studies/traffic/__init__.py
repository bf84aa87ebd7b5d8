"""How good the tracks of traffic are. `study` runs it."""

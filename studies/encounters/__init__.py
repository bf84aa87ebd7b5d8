"""How honest the leader's estimate is from any side, as shipped. `study` runs it."""

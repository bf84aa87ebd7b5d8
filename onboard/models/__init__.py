"""Models: what moves and what is seen, as functions over rows of states."""

"""The truth: how aircraft move, by dynamics of the simulator's own."""

"""The true motion of the formation's aircraft, and the random streams of the simulation."""

"""The common parts of the tracker studies: scenes, trackers, outcomes, reference trajectories."""

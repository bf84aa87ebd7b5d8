"""What the studies of tracker papers share: scenes, trackers, outcomes, reference trajectories."""

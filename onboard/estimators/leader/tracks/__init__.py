"""A target's track: its images, its life cycle and what it reports. Start reading at `track`."""

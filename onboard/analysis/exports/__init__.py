"""Estimates for other programs: CSV, Parquet, TUM trajectories, MCAP for Foxglove, and bags of ROS 2."""

"""Exports of estimates: CSV, Parquet, TUM trajectories, MCAP for Foxglove, ROS 2 bags."""

"""Recorded flights -> records: DataFlash, ULog, a ground station's .tlog, and our own MCAP."""

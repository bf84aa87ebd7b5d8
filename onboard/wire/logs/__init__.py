"""Recorded flights -> records: DataFlash, ULog, a ground station's .tlog, our MCAP."""

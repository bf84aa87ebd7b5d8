"""Other traffic, from radar, ADS-B, reported positions and GNSS.

Start reading at `estimator`, then `tracker`.
"""

"""The leader: its motion relative to us, from three points of it in our camera. Start reading at `estimator`."""

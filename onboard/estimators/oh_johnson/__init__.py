"""Oh & Johnson's filter as an estimator of its own: the smallest complete one, and the one to read first."""

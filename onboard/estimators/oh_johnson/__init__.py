"""Oh & Johnson's filter as an estimator: the smallest complete one, and the one to read first."""

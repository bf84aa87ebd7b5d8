"""Our own state, robust against model error and faults. Start reading at `estimator`."""

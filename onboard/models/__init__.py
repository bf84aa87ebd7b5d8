"""Models of motion and of measurements, as functions over rows of states."""

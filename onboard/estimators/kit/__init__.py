"""Components that several estimators use."""

"""A flight on one page: series, figures, the vehicle's own figures, and a verdict."""

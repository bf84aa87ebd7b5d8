"""Oh and Johnson: relative motion from three points in an image. `study` runs it."""

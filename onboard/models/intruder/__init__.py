"""Another aircraft: its motion, measurements of it, and the errors that these share."""

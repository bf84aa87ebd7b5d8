"""Another aircraft: its motion, what a radar and its own reports measure of it, and the errors all of these
share."""

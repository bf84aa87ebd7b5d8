"""A SITL-style simulator: MAVLink and camera streams, and their truth."""

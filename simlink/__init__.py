"""A SITL-style source of MAVLink and camera streams, with truth."""

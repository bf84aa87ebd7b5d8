"""A camera's delay, mount and focal length, and an airframe's constants, from one flight."""

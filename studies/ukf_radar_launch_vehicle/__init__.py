"""Varaprasad et al.: unscented and extended filters on a launch vehicle. `study` runs it."""

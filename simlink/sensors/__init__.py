"""Sensors: measurements of the truth, with noise, delays and losses."""

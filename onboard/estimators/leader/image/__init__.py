"""Measurements of one image, independent of what is believed of the leader."""

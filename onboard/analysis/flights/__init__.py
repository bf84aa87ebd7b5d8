"""Recorded flights through the pipeline: one, many, and several filters on the same bytes."""

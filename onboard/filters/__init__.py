"""Filters: arithmetic on arrays, generic over models. No time, no input or output, no configuration."""

"""Compiled loops over arrays, private to `onboard.filters`: others call the public families."""

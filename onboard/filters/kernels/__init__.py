"""Compiled loops over arrays, private to `onboard.filters`.

Use the public families instead.
"""

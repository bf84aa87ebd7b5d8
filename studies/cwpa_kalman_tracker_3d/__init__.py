"""Lazarov et al.: a linear Kalman tracker in three dimensions. `study` runs it."""

"""Flights after they were flown: replayed, scored, compared, reported, exported, and calibrated from."""

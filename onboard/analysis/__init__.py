"""Recorded flights: replay, scores, comparison, reports, exports and calibration."""

"""Random encounters of two aircraft, by family and seed.

Geometry, courses, headings, speeds, wind and sensors are drawn around the values that estimators assume, never
exactly at them. Start at `encounter.make_encounter`.
"""

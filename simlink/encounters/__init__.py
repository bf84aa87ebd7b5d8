"""Random encounters of two aircraft, by family and seed. Geometry, courses, noses, speeds, wind and sensors are
drawn around what estimators suppose, and never at it. `encounter.make_encounter` is the way in."""

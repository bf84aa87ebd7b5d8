"""Wire formats: the only place that knows degE7, cm/s, milliseconds and message numbers.

`mavlink_decode` and `mavlink_encode` turn MAVLink frames into records and back, `points` reads the JSON of
camera points, `tlog` reads and writes recordings. Nothing here opens a socket or reads a clock.
"""

"""Wire formats: the only place that knows degE7, cm/s, milliseconds and message numbers.

`mavlink_decode` and `mavlink_encode` turn MAVLink frames into records and back; `points`, `radar` and `ranges`
read JSON documents; `tlog`, `ulog` and `recording` read logs. Nothing here opens a socket or reads a clock.
"""

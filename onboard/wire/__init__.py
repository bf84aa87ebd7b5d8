"""Wire formats: the only place that knows degE7, cm/s, milliseconds and message numbers.

`mavlink` turns MAVLink frames into records and back, `documents` reads JSON, `ros` what cameras send in ROS 2, and
`logs` recorded flights; `datagrams` picks one of them by a datagram's encoding. Nothing here opens a socket or
reads a clock.
"""

"""Wire formats: the only place that knows degE7, cm/s, milliseconds and message numbers.

`mavlink_decode` and `mavlink_encode` turn MAVLink frames into records and back; `points`, `radar` and `ranges`
read JSON documents; `tlog`, `ulog` and `recording` read logs. Nothing here opens a socket or reads a clock.
"""

import os

# If this were set, pymavlink would accept frames with a wrong checksum. It reads it when it is imported.
os.environ.pop("MAV_IGNORE_CRC", None)

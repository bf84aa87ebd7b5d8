"""Numbers of MAVLink's enumerations that more than one part knows."""

from typing import Final

ARDUPILOT: Final = 3  # MAV_AUTOPILOT
PX4: Final = 12  # MAV_AUTOPILOT_PX4
NO_AUTOPILOT: Final = 8  # MAV_AUTOPILOT_INVALID
AUTOPILOT_NAMES: Final = {ARDUPILOT: "ArduPilot", PX4: "PX4"}
BODY_FRD: Final = 12  # MAV_FRAME_BODY_FRD

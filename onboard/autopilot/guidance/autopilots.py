"""The modes in which autopilots fly setpoints, and the parameters that limit them: a record for each autopilot.

Read in the sources of PX4 1.17 and ArduCopter 4.7-dev; docs/px4.md and docs/ardupilot.md say what each mode does.
"""

import math
from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from onboard.autopilot.guidance.law import Limits
from onboard.messages import Heartbeat
from onboard.messages.mavlink_enums import ARDUPILOT, PX4

MULTIROTORS: Final = frozenset({2, 3, 4, 13, 14, 15, 29, 35})  # MAV_TYPE, helicopters included
CM: Final = 0.01  # m
CENTIDEGREE: Final = math.radians(0.01)
# Plausible values of what a parameter limits: speed, acceleration, jerk, yaw rate, in the units of `Limits`.
PLAUSIBLE: Final = Limits((1.0, 30.0), (0.5, 10.0), (1.0, 50.0), (0.1, 6.3))  # type: ignore[arg-type]


class SetpointMode(NamedTuple):
    """A flight mode that flies setpoints. `is_on`: whether a custom_mode is that mode. `needs_stream`: it can be
    entered only while setpoints come. `limits`: field of `Limits` and unit of each parameter that limits the
    vehicle. `advice`: whether a value of a parameter is right, and what to do if it is not."""

    name: str
    is_on: Callable[[int], bool]
    needs_stream: bool
    limits: Mapping[str, tuple[str, float]]
    advice: Mapping[str, tuple[Callable[[float], bool], str]]
    messages: tuple[str, ...] = ("EXTENDED_SYS_STATE",)  # that tell of the mode, and whether the vehicle flies


OFFBOARD: Final = SetpointMode(
    name="OFFBOARD",
    is_on=lambda custom_mode: custom_mode >> 16 & 0xFF == 6,
    needs_stream=True,
    limits={
        "MPC_XY_VEL_MAX": ("speed", 1.0),
        "MPC_ACC_HOR": ("acceleration", 1.0),
        "MPC_JERK_AUTO": ("jerk", 1.0),
        "MPC_YAWRAUTO_MAX": ("yaw_rate", math.radians(1.0)),
    },
    advice={
        "COM_OBL_RC_ACT": (lambda value: value == 5.0, "COM_OBL_RC_ACT: set 5 (Hold), in case the daemon dies")
    },
    messages=("EXTENDED_SYS_STATE", "CURRENT_MODE"),
)
GUIDED: Final = SetpointMode(
    name="GUIDED",
    is_on=lambda custom_mode: custom_mode == 4,
    needs_stream=False,
    limits={
        "WPNAV_SPEED": ("speed", CM),
        "WP_SPD": ("speed", 1.0),
        "WPNAV_ACCEL": ("acceleration", CM),
        "WP_ACC": ("acceleration", 1.0),
        "ATC_SLEW_YAW": ("yaw_rate", CENTIDEGREE),
    },
    advice={
        "GUID_TIMEOUT": (lambda value: value <= 1.5, "GUID_TIMEOUT: set 1, in case the daemon dies"),
        "GUID_OPTIONS": (
            lambda value: int(value) & 0b11_0000 == 0,
            "GUID_OPTIONS: clear 16 and 32, which ignore setpoints",
        ),
    },
)


def setpoint_mode(heartbeat: Heartbeat) -> SetpointMode | None:
    """Return the setpoint mode of a PX4 or ArduCopter multirotor, None for any other vehicle."""
    if heartbeat.vehicle_type not in MULTIROTORS:
        return None
    return {PX4: OFFBOARD, ARDUPILOT: GUIDED}.get(heartbeat.autopilot)


def limited_by(limits: Limits, mode: SetpointMode, name: str, value: float) -> tuple[Limits, str]:
    """Limits under a parameter of the autopilot, and why it is not used in words, else what is wrong with it,
    or ""."""
    field, unit = mode.limits.get(name, ("", 0.0))
    if field:
        least, most = getattr(PLAUSIBLE, field)
        if not (math.isfinite(value) and least <= value * unit <= most):
            return limits, f"{name} {value:g} is implausible, so it is not used"
        return limits._replace(**{field: min(getattr(limits, field), value * unit)}), ""
    advice = mode.advice.get(name)
    return limits, "" if advice is None or (math.isfinite(value) and advice[0](value)) else advice[1]

"""The modes in which autopilots fly setpoints, and the parameters that limit them.

Source: PX4 1.17 and ArduCopter 4.7-dev. docs/px4.md and docs/ardupilot.md describe each mode.
"""

import math
from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from onboard.autopilot.guidance.law import Limits
from onboard.messages import Heartbeat
from onboard.messages.mavlink_enums import ARDUPILOT, PX4

MULTIROTORS: Final = frozenset({2, 3, 4, 13, 14, 15, 29, 35})  # MAV_TYPE, helicopters included
# Smallest and greatest plausible value of each limit.
PLAUSIBLE_LIMITS: Final = Limits((1.0, 30.0), (0.5, 10.0), (1.0, 50.0), (0.1, 6.3))  # type: ignore[arg-type]


class SetpointMode(NamedTuple):
    """A flight mode that flies setpoints, and the autopilot's parameters that matter to it."""

    name: str
    is_on: Callable[[int], bool]  # whether a custom_mode is this mode
    needs_stream: bool  # it can be entered only while setpoints arrive
    limits: Mapping[str, tuple[str, float]]  # parameter -> field of Limits, and the parameter's unit in SI
    advice: Mapping[str, tuple[Callable[[float], bool], str]]  # parameter -> whether a value is right, the remedy
    messages: tuple[str, ...] = ("EXTENDED_SYS_STATE",)  # report the mode and whether the vehicle flies


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
    advice={"COM_OBL_RC_ACT": (lambda value: value == 5.0, "set 5 (Hold), in case the daemon dies")},
    messages=("EXTENDED_SYS_STATE", "CURRENT_MODE"),
)
GUIDED: Final = SetpointMode(
    name="GUIDED",
    is_on=lambda custom_mode: custom_mode == 4,
    needs_stream=False,
    limits={
        "WPNAV_SPEED": ("speed", 0.01),
        "WP_SPD": ("speed", 1.0),
        "WPNAV_ACCEL": ("acceleration", 0.01),
        "WP_ACC": ("acceleration", 1.0),
        "ATC_SLEW_YAW": ("yaw_rate", math.radians(0.01)),
    },
    advice={
        "GUID_TIMEOUT": (lambda value: value <= 1.5, "set 1, in case the daemon dies"),
        "GUID_OPTIONS": (lambda value: int(value) & 0b11_0000 == 0, "clear 16 and 32, which ignore setpoints"),
    },
)


def setpoint_mode(heartbeat: Heartbeat) -> SetpointMode | None:
    """Return the setpoint mode of a PX4 or ArduCopter multirotor, None for any other vehicle."""
    if heartbeat.vehicle_type not in MULTIROTORS:
        return None
    return {PX4: OFFBOARD, ARDUPILOT: GUIDED}.get(heartbeat.autopilot)


def apply_parameter(limits: Limits, mode: SetpointMode, name: str, value: float) -> tuple[Limits, str]:
    """Lower the limits to a parameter's value. Returns them and a warning, or ""."""
    field, unit = mode.limits.get(name, ("", 0.0))
    if field:
        smallest, greatest = getattr(PLAUSIBLE_LIMITS, field)
        if not (math.isfinite(value) and smallest <= value * unit <= greatest):
            return limits, f"{name} is {value:g}, implausible and ignored; correct it"
        return limits._replace(**{field: min(getattr(limits, field), value * unit)}), ""
    is_right, remedy = mode.advice.get(name, (math.isfinite, ""))
    if not remedy or (math.isfinite(value) and is_right(value)):
        return limits, ""
    return limits, f"{name} is {value:g}; {remedy}"

"""Series of the vehicle itself for a report, as its autopilot sends them.

Battery, motors, vibration, GPS, modes, messages and parameters.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from onboard.analysis.report.series import NumberRows
from onboard.messages import ActuatorOutputs, Battery, GpsFix, Heartbeat, Imu, Message, ParamValue, StatusText
from onboard.messages.mavlink_enums import ARDUPILOT, PX4
from onboard.messages.text import MAX_LINE_LENGTH, plain
from onboard.units import NS_PER_S

SCATTER_WINDOW_S: Final = 0.5  # over which the accelerometer's scatter is taken
MAX_DRAWN_OUTPUTS: Final = 8  # outputs that are drawn
MAX_EVENT_ROWS: Final = 500  # modes and messages
MAX_PARAMETER_ROWS: Final = 3000  # PX4 has some 1,200, ArduPilot 1,500
MAX_PARAMETER_NAME_LENGTH: Final = 16  # of a parameter
ROUNDING_RATIO: Final = 1e-6  # a smaller difference is the rounding to 32 bits
PX4_MODES: Final = {1: "MANUAL", 2: "ALTCTL", 3: "POSCTL", 4: "AUTO", 5: "ACRO", 6: "OFFBOARD", 7: "STABILIZED"}
PX4_AUTO: Final = dict(enumerate(("READY", "TAKEOFF", "LOITER", "MISSION", "RTL", "LAND"), start=1)) | {
    8: "FOLLOW_TARGET",
    9: "PRECLAND",
}
# MAV_TYPE -> the enumeration that names ArduPilot's modes
PLANES, ROVERS, SUBMARINE = frozenset({1, *range(19, 26)}), frozenset({10, 11}), 12
SEVERITY_NAMES: Final = ("emergency", "alert", "critical", "error", "warning", "notice", "info", "debug")


class Parameter(NamedTuple):
    """Values of a parameter over a flight; None for an unknown default."""

    first: float
    value: float
    set_s: float  # when the newest value was set
    default: float | None

    @property
    def is_changed(self) -> bool:
        """Whether the value is not the default, or was set in flight."""
        return not (self._is(self.first) and (self.default is None or self._is(self.default)))

    def _is(self, other: float) -> bool:
        return math.isclose(self.value, other, rel_tol=ROUNDING_RATIO) or (
            math.isnan(self.value) and math.isnan(other)
        )


class VehicleSeries:
    """One flight. Times are s on the boot clock.

    `battery`: time, V under load. `outputs`: time, pulse widths, NaN where unused. `vibration`: time, RMS of the
    differences of the specific force between samples, over sqrt(2), forward, right and down, m/s^2. `gps`: time,
    fix type, satellites, horizontal and vertical accuracy (m), latitude and longitude (degrees), NaN where not
    known. `words`: time, kind and text of changes of mode and of messages. `parameters`: by name."""

    def __init__(self) -> None:
        self.battery, self.outputs = NumberRows(2), NumberRows(1 + MAX_DRAWN_OUTPUTS)
        self.vibration, self.gps = NumberRows(4), NumberRows(7)
        self.words: list[tuple[float, str, str]] = []
        self.left_out = 0  # words beyond MAX_EVENT_ROWS
        self.parameters: dict[str, Parameter] = {}
        self.parameters_left_out = 0  # messages of those beyond MAX_PARAMETER_ROWS
        self._mode: tuple[bool, int] | None = None
        self._forces: list[tuple[float, float, float]] = []
        self._window_s = np.nan

    def hear(self, message: Message, t: float) -> None:
        """Add the next message of the autopilot, at boot time `t` (s)."""
        t_ns = round(t * NS_PER_S)
        match message:
            case Battery() if self.battery.is_due(t_ns):
                self.battery.append(t, message.voltage_v)
            case ActuatorOutputs(port=0) if self.outputs.is_due(t_ns):
                widths = [float(width) or np.nan for width in message.pwm_us[:MAX_DRAWN_OUTPUTS]]
                self.outputs.append(t, *widths, *[np.nan] * (MAX_DRAWN_OUTPUTS - len(widths)))
            case Imu():
                self._add_force(message, t)
            case GpsFix() if self.gps.is_due(t_ns):
                known = (message.satellites, message.h_acc, message.v_acc)
                numbers = (np.nan if value is None else float(value) for value in known)
                self.gps.append(t, message.fix_type, *numbers, message.lat_deg, message.lon_deg)
            case Heartbeat():
                self._add_mode(message, t)
            case ParamValue():
                self._add_parameter(message, t)
            case StatusText():
                severity = SEVERITY_NAMES[min(message.severity, len(SEVERITY_NAMES) - 1)]
                self._add_event(t, severity, message.text)

    def _add_force(self, message: Imu, t: float) -> None:
        if not t - self._window_s < SCATTER_WINDOW_S:
            steps = np.diff(np.array(self._forces or [message.f_b]), axis=0)
            if len(steps) > 1:
                self.vibration.append(t, *np.sqrt(np.mean(steps**2, axis=0) / 2.0).tolist())
            self._forces, self._window_s = [], t
        self._forces.append(message.f_b)

    def _add_mode(self, heartbeat: Heartbeat, t: float) -> None:
        mode, before = (heartbeat.armed, heartbeat.custom_mode), self._mode
        self._mode = mode
        if before == mode:
            return
        if before is None or before[1] != mode[1]:
            self._add_event(t, "mode", mode_name(heartbeat))
        if mode[0] != (before is not None and before[0]):
            self._add_event(t, "armed" if mode[0] else "disarmed", "")

    def _add_parameter(self, message: ParamValue, t: float) -> None:
        name, value = plain(message.name, MAX_PARAMETER_NAME_LENGTH), message.value
        known = self.parameters.get(name)
        if known is None and len(self.parameters) >= MAX_PARAMETER_ROWS:
            self.parameters_left_out += 1
        elif known is None:
            self.parameters[name] = Parameter(value, value, t, message.default)
        elif value != known.value:
            self.parameters[name] = known._replace(value=value, set_s=t)

    def _add_event(self, t: float, kind: str, text: str) -> None:
        if len(self.words) < MAX_EVENT_ROWS:
            self.words.append((t, kind, plain(text, MAX_LINE_LENGTH)))
        else:
            self.left_out += 1


def mode_name(heartbeat: Heartbeat) -> str:
    """Name of a flight mode, or its number if it has no name."""
    mode = heartbeat.custom_mode
    if heartbeat.autopilot == PX4:
        main, sub = mode >> 16 & 0xFF, mode >> 24 & 0xFF
        name = PX4_MODES.get(main, str(mode))
        return f"{name} {PX4_AUTO.get(sub, str(sub))}" if name == "AUTO" else name
    if heartbeat.autopilot != ARDUPILOT:
        return str(mode)
    from pymavlink.dialects.v20 import ardupilotmega as dialect  # noqa: PLC0415 - as late as it is needed

    kind = heartbeat.vehicle_type
    family = "PLANE" if kind in PLANES else "ROVER" if kind in ROVERS else "SUB" if kind == SUBMARINE else "COPTER"
    found = dialect.enums[f"{family}_MODE"].get(mode)
    return str(mode) if found is None else str(found.name).split("_", 2)[-1]

"""`onboard calibrate --mass`: what an ordinary flight says of the airframe, as lines to paste."""

import argparse
import math
from collections import Counter
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from onboard import UserError
from onboard.analysis.calibration.airframe import (
    AirframeFit,
    AirframeMeasures,
    FittedValue,
    RecordedFlight,
    fit_airframe,
)
from onboard.analysis.flights.replay import aligned
from onboard.arrays import Array
from onboard.config import Config
from onboard.geometry.rotations import matrix_from_quaternion
from onboard.messages import ActuatorOutputs, Battery, Imu, Message, OwnPose
from onboard.units import S_PER_NS

MOST_SIGMA: Final = 0.15  # sigma over value of what a fault is named by: one known worse is not offered
MOTOR_TIME_S: Final = 0.02  # assumed: an ordinary flight does not show it
WANTED: Final = (ActuatorOutputs, Imu, Battery)


def calibrate_airframe(arguments: argparse.Namespace, config: Config) -> list[str]:
    """The lines to print. Raises UserError."""
    if arguments.rotors is None:
        raise UserError("--mass needs --rotors: [[forward_m, right_m, sense], ...], one each, sense 1 or -1")
    try:
        rotors = np.array(msgspec.json.decode(arguments.rotors, type=list[tuple[float, float, float]]))
    except msgspec.DecodeError as error:
        raise UserError(f"--rotors: {error}: expected [[forward_m, right_m, sense], ...]") from error
    if len(rotors) < 4 or not np.isin(rotors[:, 2], (-1, 1)).all():
        raise UserError("--rotors: at least four, each [forward_m, right_m, sense] with sense 1 or -1")
    if not arguments.mass > 0 or not (arguments.voltage is None or arguments.voltage > 0):
        raise UserError("--mass and --voltage must be positive")
    low, high = arguments.pwm
    if not low < high:
        raise UserError("--pwm: the first must be below the second")
    flight = collect_flight(arguments.log, config, (low, high), len(rotors), arguments.voltage, arguments.until)
    known = AirframeMeasures(arguments.mass, rotors, MOTOR_TIME_S, arguments.voltage or 1.0)
    return described_airframe(fit_airframe(flight, known), known, (low, high))


def collect_flight(
    log: Path,
    config: Config,
    pwm_us: tuple[float, float],
    rotors: int,
    full_voltage: float | None,
    until: float | None = None,
) -> RecordedFlight:
    """IMU, commands, voltage and velocity of a log on the boot clock, up to `until` s from its start. Without
    `full_voltage` voltages are not used. Raises UserError."""
    ordered, poses = _aligned(log, config, until)
    imu = [m for m in ordered if isinstance(m, Imu)]
    outputs = [m for m in ordered if isinstance(m, ActuatorOutputs) and len(m.pwm_us) >= rotors]
    running = Counter(m.port for m in outputs if min(m.pwm_us[:rotors]) > pwm_us[0])
    outputs = [m for m in outputs if m.port == max(running, key=lambda port: (running[port], -port), default=0)]
    batteries = [m for m in ordered if isinstance(m, Battery)]
    if len(imu) < 2 or len(outputs) < 2 or len(poses) < 2:
        raise UserError(
            f"{log}: {len(imu)} IMU samples, {len(outputs)} outputs of {rotors} motors (SERVO_OUTPUT_RAW),"
            f" {len(poses)} own poses: all three are needed"
        )
    if full_voltage is not None and not batteries:
        raise UserError(f"{log}: no battery's voltage (BATTERY_STATUS or SYS_STATUS), but --voltage is given")
    t, command_t = _seconds(imu), _seconds(outputs)
    commands = (np.array([m.pwm_us[:rotors] for m in outputs], float) - pwm_us[0]) / (pwm_us[1] - pwm_us[0])
    voltage = np.ones(len(outputs))
    if full_voltage is not None:
        voltage = np.interp(command_t, _seconds(batteries), [m.voltage_v for m in batteries])
    return RecordedFlight(
        t,
        np.array([m.f_b for m in imu]),
        np.array([m.omega_b for m in imu]),
        _velocity_b(poses, t),
        command_t,
        np.clip(commands, 0.0, 1.0),
        voltage,
    )


def _aligned(log: Path, config: Config, until: float | None) -> tuple[list[Message], list[OwnPose]]:
    """Read the wanted messages of a log's first seconds, ordered by boot time, and all own poses."""
    items = [*aligned(log, config, lambda m: isinstance(m, WANTED))]
    poses, found = [i for i in items if isinstance(i, OwnPose)], [i for i in items if isinstance(i, Message)]
    ordered = sorted({(type(m), m.t_ns): m for m in found}.values(), key=lambda m: m.t_ns)
    start = ordered[0].t_ns if ordered else 0
    return [m for m in ordered if until is None or (m.t_ns - start) * S_PER_NS <= until], poses


def _seconds(messages: list[Imu] | list[ActuatorOutputs] | list[Battery]) -> Array:
    return np.array([m.t_ns * S_PER_NS for m in messages])


def _velocity_b(poses: list[OwnPose], t: Array) -> Array:
    poses = list({pose.t_ns: pose for pose in sorted(poses, key=lambda p: p.t_ns)}.values())
    v_b = np.array([matrix_from_quaternion(np.array(p.q_nb)).T @ np.array(p.v_F_n) for p in poses])
    return np.column_stack([np.interp(t, [p.t_ns * S_PER_NS for p in poses], v_b[:, i]) for i in range(3)])


def described_airframe(found: AirframeFit, known: AirframeMeasures, pwm_us: tuple[float, float]) -> list[str]:
    """Lines for a person: values with sigmas, what the flight does not show, then the configuration to paste."""
    torque = FittedValue(found.torque_over_izz.value * found.izz, found.torque_over_izz.sigma * found.izz)
    rows = (
        ("thrust_max_n", found.thrust, "N"),
        ("drag_per_s", found.drag, "1/s"),
        ("Ixx", found.ixx, "kg m^2"),
        ("Iyy", found.iyy, "kg m^2"),
        ("torque over Izz", found.torque_over_izz, "1/(kg m)"),
    )
    lines = [f"{name:16} {one.value:11.5g} +- {one.sigma:.2g} {unit}" for name, one, unit in rows]
    lines += [
        f"hover command    {found.hover:11.3f} of the range",
        f"from {found.windows} windows of {found.window:.2g} s in the air",
        f"given: mass {known.mass:g} kg, to which thrust and inertia are in proportion; the rotors' places",
        "not shown by a flight: Izz apart from torque_per_thrust_m (Izz = Ixx + Iyy is taken, as of a flat one);",
        f"not shown either: motor_time_s ({known.motor_time:g} is taken)",
    ]
    if known.full_voltage == 1.0:
        lines.append("without --voltage, the thrust is that of this flight's battery")
    needed = {"thrust": found.thrust, "Ixx": found.ixx, "Iyy": found.iyy, "torque over Izz": found.torque_over_izz}
    missing = [name for name, one in needed.items() if not one.share < MOST_SIGMA]
    if missing:
        unknown = f"not known to {100 * MOST_SIGMA:.0f} %: {', '.join(missing)}"
        return [*lines, f"{unknown}; nothing is offered: roll, pitch, yaw more"]
    rotors = ", ".join(f"[{x:g}, {y:g}, {int(s)}]" for x, y, s in known.rotors.tolist())
    lines += [
        "",
        "[estimator.own_state]",
        'airframe = "custom"',
        "",
        "[estimator.own_state.custom]",
        f"mass_kg = {known.mass:g}",
        f"inertia_kg_m2 = [{found.ixx.value:.4g}, {found.iyy.value:.4g}, {found.izz:.4g}]",
        f"rotors = [{rotors}]",
        f"thrust_max_n = {found.thrust.value:.4g}",
        f"torque_per_thrust_m = {torque.value:.4g}",
        f"motor_time_s = {known.motor_time:g}",
        f"pwm_us = [{pwm_us[0]:g}, {pwm_us[1]:g}]",
    ]
    if math.isfinite(found.drag.share) and found.drag.share < 0.5:
        lines.append(f"drag_per_s = {found.drag.value:.4g}")
    if known.full_voltage != 1.0:
        lines.append(f"full_voltage_v = {known.full_voltage:g}")
    return lines

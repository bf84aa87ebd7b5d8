"""Faults of our own vehicle, found by comparing its motors' commands with its motion.

Over a third of a second, the commands should have given a thrust and an angular momentum; accelerometer and gyro
measure the actual ones. The thrust per command changes with the battery (`thrust`). The difference is compared
with the signature of each fault: one weak motor lacks thrust and a torque about its own place; another mass (or
weakness of all motors, which looks the same in hover) changes thrust without torque; a gust pushes sideways, where
no rotor can.
"""

import math
from collections import deque
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.own_state.config import AirframeConfig
from onboard.estimators.own_state.thrust import ThrustScale
from onboard.messages import ActuatorOutputs, Fault, FaultKind, Imu
from onboard.models.own_motion import GRAVITY
from onboard.units import NS_PER_S

AVERAGING_WINDOW_NS: Final = 300_000_000
MIN_FINDING_DURATION_NS: Final = 150_000_000  # before a fault is reported
MIN_ABSENCE_DURATION_NS: Final = NS_PER_S  # before a fault is withdrawn
MAX_INPUT_AGE_NS: Final = 300_000_000  # of motor outputs and samples
MAX_TIME_WITHOUT_MOTORS_NS: Final = 5 * NS_PER_S  # While armed; then the outputs do not contain our motors.
REPORT_INTERVAL_NS: Final = NS_PER_S  # of reports about missing motors
MIN_FLYING_THRUST_RATIO: Final = 0.6  # of the weight
MIN_MOTOR_LOSS_FRACTION: Final = 0.12  # of one motor's thrust
MIN_MASS_CHANGE_FRACTION: Final = 0.12  # of the mass
MAX_BALANCED_TORQUE_FRACTION: Final = 0.08  # of a motor's torque; more of it indicates a single motor
MIN_GUST_ACCELERATION: Final = 1.5  # m/s^2, sideways
MIXING_SIGMA: Final = (0.03, 0.03, 0.03, 0.1)  # of thrust and torques, as fractions of one motor's


class Alarm:
    """One kind of fault: raised after it has lasted, withdrawn after it has been absent."""

    def __init__(self, kind: FaultKind, unit: str) -> None:
        self._kind, self._unit = kind, unit
        self.clear()

    def clear(self) -> None:
        """Withdraw the alarm."""
        self._since_ns: int | None = None
        self._last_ns = 0
        self._part = ""
        self.fault: Fault | None = None

    @property
    def is_suspected(self) -> bool:
        """Whether the fault is reported, or may soon be."""
        return self._since_ns is not None

    def judge(self, t_ns: int, present: bool, magnitude: float, threshold: float, part: str = "") -> None:
        """Update with whether the mean over the window exceeds its threshold at `t_ns`."""
        if not present:
            self.absent(t_ns)
            return
        if self._since_ns is None or part != self._part:
            self._since_ns, self._part = t_ns, part
        self._last_ns = t_ns
        if t_ns - self._since_ns < MIN_FINDING_DURATION_NS:
            return
        if self.fault is None or self.fault.part != part:
            # After a step, the mean over the window crosses the threshold with this delay.
            rise = round(AVERAGING_WINDOW_NS * min(threshold / max(abs(magnitude), 1e-9), 1.0))
            self.fault = Fault(
                kind=self._kind, part=part, t_onset_ns=self._since_ns - rise, magnitude=magnitude, unit=self._unit
            )

    def absent(self, t_ns: int) -> None:
        """Update with nothing above the threshold at `t_ns`."""
        if self.fault is None:
            self._since_ns = None
        if t_ns - self._last_ns > MIN_ABSENCE_DURATION_NS:
            self.clear()


class Balance(NamedTuple):
    """Integrals over time up to one IMU sample, and the angular momentum (3,) at that time.

    The integrals are in one array: unexplained force, torque (3), lateral specific force (2), and each rotor's
    thrust.
    """

    t_ns: int
    integrals: Array
    momentum: Array


TORQUE, LATERAL, THRUSTS = slice(1, 4), slice(4, 6), slice(6, None)


class FaultMonitor:
    """Comparison of commands with motion. Without an airframe it does nothing."""

    def __init__(self, airframe: AirframeConfig | None) -> None:
        self._airframe = airframe
        if airframe is not None:
            places = np.array(airframe.rotors)
            self._inertia = np.array(airframe.inertia_kg_m2)
            spin = places[:, 2] * airframe.torque_per_thrust_m
            self._mixing = np.stack([np.ones(len(places)), -places[:, 1], places[:, 0], spin])  # (4, rotors)
            self._arms = np.abs(self._mixing).max(axis=1)
            self._sigma = np.array(MIXING_SIGMA) * self._arms  # of a motor with a thrust of 1 N
        self._scale = ThrustScale(None if airframe is None else airframe.full_voltage_v)
        self._commands: Array | None = None  # shares of the range, (rotors,)
        self._commands_ns = 0
        self._port, self._ran_ns = 0, 0  # of the motors, and when its outputs last ran them
        self._seen_ns: int | None = None  # when outputs last ran the motors, or when they did not have to
        self._shares: Array | None = None  # the commands as the motors follow them
        self._balances: deque[Balance] = deque()
        self._flying_since_ns: int | None = None
        self._missing_torque = np.zeros(3)  # mean over the window
        self._motor = Alarm(FaultKind.MOTOR, "share of its thrust lost")
        self._mass = Alarm(FaultKind.MASS, "times the known mass")
        self._gust = Alarm(FaultKind.GUST, "m/s^2")

    def faults(self) -> tuple[Fault, ...]:
        """Return the present faults."""
        found = (alarm.fault for alarm in (self._motor, self._mass, self._gust))
        return tuple(fault for fault in found if fault is not None)

    def receive_outputs(self, message: ActuatorOutputs, *, armed: bool = False) -> bool:
        """Receive the motors' commands, of the first port whose outputs run them.

        The motors may move to another port: with DShot they are auxiliary outputs, and the main ones rest. Returns
        whether to report, once a second, that no port runs them although the vehicle is `armed`.
        """
        a = self._airframe
        if a is None:
            return False
        runs = min((*message.pwm_us, *(0,) * len(a.rotors))[: len(a.rotors)]) > a.pwm_us[0]
        self._receive_commands(a, message, runs=runs)
        if runs or not armed or self._seen_ns is None or message.t_ns < self._seen_ns:
            self._seen_ns = message.t_ns
        if message.t_ns - self._seen_ns < MAX_TIME_WITHOUT_MOTORS_NS:
            return False
        self._seen_ns = message.t_ns - MAX_TIME_WITHOUT_MOTORS_NS + REPORT_INTERVAL_NS
        return True

    def _receive_commands(self, a: AirframeConfig, message: ActuatorOutputs, *, runs: bool) -> None:
        if len(message.pwm_us) < len(a.rotors):
            return
        low, high = a.pwm_us
        rests = not 0 <= message.t_ns - self._ran_ns <= MAX_INPUT_AGE_NS
        if runs and (message.port < self._port or rests):
            self._port = message.port
        if message.port != self._port:
            return
        self._ran_ns = message.t_ns if runs else self._ran_ns
        commands = (np.array(message.pwm_us[: len(a.rotors)], float) - low) / (high - low)
        self._commands, self._commands_ns = np.clip(commands, 0.0, 1.0), message.t_ns

    def receive_voltage(self, voltage_v: float) -> None:
        """Receive the battery's voltage under load, V."""
        self._scale.receive_voltage(voltage_v)

    def receive_imu(self, message: Imu, velocity_b: Array | None) -> Array | None:
        """Compare commands and motion at one IMU sample.

        Returns the vehicle's angular acceleration (3,) by its motors' torque and the missing torque, a mean over
        the window; None if the commands are unknown. `velocity_b` is used for the drag.
        """
        a, t_ns = self._airframe, message.t_ns
        if a is None or self._commands is None or t_ns - self._commands_ns > MAX_INPUT_AGE_NS:
            self._balances.clear()
            self._shares = None
            return None
        last = self._balances[-1] if self._balances else None
        if last is not None and not 0 < t_ns - last.t_ns <= MAX_INPUT_AGE_NS:
            self._balances.clear()
            last = None
        dt = 0.0 if last is None else (t_ns - last.t_ns) / NS_PER_S
        if self._shares is None:
            self._shares = self._commands
        fading = np.exp(-dt / a.motor_time_s) if a.motor_time_s > 0 else 0.0
        self._shares = self._commands + (self._shares - self._commands) * fading
        thrusts = a.thrust_max_n * self._scale.factor * self._shares**2
        wrench = self._mixing @ thrusts
        f_b, omega = np.array(message.f_b), np.array(message.omega_b)
        momentum = self._inertia * omega
        torque = wrench[1:] - _cross(omega, momentum)
        drag = np.zeros(2) if velocity_b is None else a.drag_per_s * velocity_b[:2]
        force, lateral = -f_b[2] * a.mass_kg - wrench[0], f_b[:2] + drag
        step = dt * np.concatenate(([force], torque, lateral, thrusts))
        now = Balance(t_ns, step if last is None else last.integrals + step, momentum)
        self._balances.append(now)
        self._compare(a, now)
        return np.asarray((torque + self._missing_torque) / self._inertia)

    def _compare(self, a: AirframeConfig, now: Balance) -> None:
        """Compare the means over the window with the signature of each fault."""
        while len(self._balances) > 1 and self._balances[1].t_ns <= now.t_ns - AVERAGING_WINDOW_NS:
            self._balances.popleft()
        then = self._balances[0]
        if now.t_ns - then.t_ns < 0.9 * AVERAGING_WINDOW_NS:
            return
        span = (now.t_ns - then.t_ns) / NS_PER_S
        change = now.integrals - then.integrals
        thrusts = change[THRUSTS] / span
        if not self._is_flying(a, now.t_ns, float(thrusts.sum())):
            self._absent(now.t_ns)
            self._scale.rest(now.t_ns)
            return
        missing = change[:4] / span
        missing[1:] = (now.momentum - then.momentum - change[TORQUE]) / span
        self._missing_torque = missing[1:]
        push = math.hypot(*(change[LATERAL] / span).tolist())
        if self._scale.is_settling(now.t_ns):
            self._absent(now.t_ns)
        else:
            self._compare_motors(missing, thrusts, push, now.t_ns)
            self._gust.judge(now.t_ns, push > MIN_GUST_ACCELERATION, push, MIN_GUST_ACCELERATION)
        alarms = (self._motor, self._mass, self._gust)
        if push < MIN_GUST_ACCELERATION and not any(alarm.is_suspected for alarm in alarms):
            self._scale.learn(now.t_ns, 1.0 + float(missing[0] / thrusts.sum()))

    def _absent(self, t_ns: int) -> None:
        for alarm in (self._motor, self._mass, self._gust):
            alarm.absent(t_ns)

    def _is_flying(self, a: AirframeConfig, t_ns: int, thrust: float) -> bool:
        """Return whether the thrust (N) has carried the vehicle for a second."""
        if thrust < MIN_FLYING_THRUST_RATIO * a.mass_kg * GRAVITY:
            self._flying_since_ns = None
        elif self._flying_since_ns is None:
            self._flying_since_ns = t_ns
        return self._flying_since_ns is not None and t_ns - self._flying_since_ns >= NS_PER_S

    def _compare_motors(self, missing: Array, thrusts: Array, push: float, t_ns: int) -> None:
        """Test for one weak motor, or another mass.

        `missing` (4,) is the thrust (N) and torque (N m) that the commands do not explain. The mass is not tested
        during a push: on a tilted vehicle a push lifts, too.
        """
        sigma = self._sigma * thrusts.mean()
        sigma[0] *= len(thrusts)
        e = missing / sigma
        columns = -self._mixing * thrusts / sigma[:, None]  # signature of the complete loss of each motor
        losses = (columns.T @ e) / (columns**2).sum(axis=0)
        costs = ((e[:, None] - losses * columns) ** 2).sum(axis=0)
        motor = int(np.argmin(costs))
        is_motor = bool(losses[motor] > MIN_MOTOR_LOSS_FRACTION and costs[motor] < float((e[1:] ** 2).sum()))
        self._motor.judge(t_ns, is_motor, float(losses[motor]), MIN_MOTOR_LOSS_FRACTION, f"motor {motor + 1}")
        more_lift = float(missing[0] / thrusts.sum())  # share of the commanded lift
        torque = float(np.abs(missing[1:3] / (self._arms[1:3] * thrusts.mean())).max())
        mass = 1.0 / max(1.0 + more_lift, 0.1)
        change = abs(mass - 1.0)
        is_mass = (
            not is_motor
            and torque < MAX_BALANCED_TORQUE_FRACTION
            and push < 0.5 * MIN_GUST_ACCELERATION
            and change > MIN_MASS_CHANGE_FRACTION
        )
        self._mass.judge(
            t_ns, is_mass, mass, MIN_MASS_CHANGE_FRACTION / max(change, MIN_MASS_CHANGE_FRACTION) * mass
        )


def _cross(a: Array, b: Array) -> Array:
    """Return a x b (3,)."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])

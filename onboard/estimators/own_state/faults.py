"""What is wrong with our own vehicle: what it was told to do, held against what it did.

Over a third of a second, the motors' commands should have given a thrust and an angular momentum; accelerometer
and gyro say what came of them. What is missing is held against what each fault would leave: one weak motor takes
thrust and a torque about its own place; another mass (or all motors weaker, which in hover looks the same) takes
thrust and no torque; a gust pushes sideways, where no rotor can. Sensors are told apart by time: a wrong model's
innovations keep their sign, a single wrong value's do not.
"""

from collections import Counter, deque
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from onboard.arrays import Array
from onboard.estimators.own_state.config import Airframe
from onboard.estimators.own_state.measurements import Measured
from onboard.filters.belief import Update
from onboard.messages import ActuatorOutputs, Fault, FaultKind, Imu
from onboard.models.own_motion import GRAVITY

NS: Final = 1_000_000_000
WINDOW_NS: Final = 300_000_000  # what is compared is the mean over this
HOLD_NS: Final = 150_000_000  # a finding must last so long to be named
CLEAR_NS: Final = NS  # and be absent so long to be taken back
STALE_NS: Final = 300_000_000  # motor outputs or samples this old say nothing of now
WEAKEST: Final = 0.6  # of the weight: with less thrust we are not flying
MOTOR_LOSS: Final = 0.12  # share of one motor's thrust
MASS_CHANGE: Final = 0.12  # share of the mass
TORQUE_CLEAR: Final = 0.08  # share of a motor's torque, below which nothing speaks of one motor
PUSH: Final = 1.5  # m/s^2 sideways
WRONG_VALUES: Final = 3  # within a second
NEAR: Final = 2.0  # deviations: before and after a wrong value, innovations are this small
SHAKEN_NS: Final = 400_000_000  # about the onset of another fault, innovations say nothing of sensors
TRUST: Final = (0.03, 0.03, 0.03, 0.1)  # how well thrust and torques are known, shares of one motor's


class Alarm:
    """One kind of fault: named once a finding has lasted, taken back once it has been absent."""

    def __init__(self, kind: FaultKind, unit: str) -> None:
        self._kind, self._unit = kind, unit
        self.clear()

    def clear(self) -> None:
        """Nothing found."""
        self._since_ns: int | None = None
        self._last_ns = 0
        self._part = ""
        self.fault: Fault | None = None

    def found(self, t_ns: int, part: str, magnitude: float, threshold: float) -> None:
        """At `t_ns` the mean over the window exceeds its threshold."""
        if self._since_ns is None or part != self._part:
            self._since_ns, self._part = t_ns, part
        self._last_ns = t_ns
        if t_ns - self._since_ns < HOLD_NS:
            return
        if self.fault is None or self.fault.part != part:
            # of a step, the mean over a window reaches the threshold this much later
            rise = round(WINDOW_NS * min(threshold / max(abs(magnitude), 1e-9), 1.0))
            self.fault = Fault(
                kind=self._kind, part=part, t_onset_ns=self._since_ns - rise, magnitude=magnitude, unit=self._unit
            )

    def absent(self, t_ns: int) -> None:
        """At `t_ns` it does not."""
        if self.fault is None:
            self._since_ns = None
        if t_ns - self._last_ns > CLEAR_NS:
            self.clear()


class Balance(NamedTuple):
    """Sums up to one IMU sample: unexplained force, each rotor's thrust, torque, lateral specific force (all times
    dt); and the angular momentum then."""

    t_ns: int
    force: float
    thrusts: Array
    torque: Array
    lateral: Array
    momentum: Array


class FaultMonitor:
    """Without an airframe only sensors are watched."""

    def __init__(self, airframe: Airframe | None) -> None:
        self._airframe = airframe
        if airframe is not None:
            places = np.array(airframe.rotors)
            self._inertia = np.array(airframe.inertia_kg_m2)
            spin = places[:, 2] * airframe.torque_per_thrust_m
            self._mixing = np.stack([np.ones(len(places)), -places[:, 1], places[:, 0], spin])  # (4, rotors)
            self._arms = np.abs(self._mixing).max(axis=1)
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self._told: Array | None = None
        self._told_ns = 0
        self._shares: Array | None = None
        self._balances: deque[Balance] = deque()
        self._flying_since_ns: int | None = None
        self._missing_torque = np.zeros(3)  # mean over the window
        self._signs: dict[str, tuple[int, Array, Array]] = {}
        self._wrong: deque[tuple[int, str]] = deque()
        self._alarms = {
            FaultKind.MOTOR: Alarm(FaultKind.MOTOR, "share of its thrust lost"),
            FaultKind.MASS: Alarm(FaultKind.MASS, "times the known mass"),
            FaultKind.GUST: Alarm(FaultKind.GUST, "m/s^2"),
        }
        self._outliers: Fault | None = None

    def faults(self) -> tuple[Fault, ...]:
        """Those that last."""
        found = [alarm.fault for alarm in self._alarms.values()] + [self._outliers]
        return tuple(fault for fault in found if fault is not None)

    # ------------------------------------------------------------------------------ commands and motion

    def take_outputs(self, message: ActuatorOutputs) -> None:
        """What the motors are told."""
        a = self._airframe
        if a is None or len(message.pwm_us) < len(a.rotors):
            return
        low, high = a.pwm_us
        told = (np.array(message.pwm_us[: len(a.rotors)], float) - low) / (high - low)
        self._told, self._told_ns = np.clip(told, 0.0, 1.0), message.t_ns

    def take_imu(self, message: Imu, velocity_b: Array | None) -> Array | None:
        """What the vehicle felt; the angular acceleration (3,) it has now, where it can be known: what its motors
        should give it, and what has lately been missing. `velocity_b` is for the drag."""
        a, t_ns = self._airframe, message.t_ns
        if a is None or self._told is None or t_ns - self._told_ns > STALE_NS:
            self._balances.clear()
            self._shares = None
            return None
        last = self._balances[-1] if self._balances else None
        if last is not None and not 0 < t_ns - last.t_ns <= STALE_NS:
            self._balances.clear()
            last = None
        dt = 0.0 if last is None else (t_ns - last.t_ns) / NS
        if self._shares is None:
            self._shares = self._told
        fading = np.exp(-dt / a.motor_time_s) if a.motor_time_s > 0 else 0.0
        self._shares = self._told + (self._shares - self._told) * fading
        thrusts = a.thrust_max_n * self._shares**2
        wrench = self._mixing @ thrusts
        omega, f_b = np.array(message.omega_b), np.array(message.f_b)
        momentum = self._inertia * omega
        (p, q, r), (hp, hq, hr) = omega.tolist(), momentum.tolist()
        torque = wrench[1:] - np.array([q * hr - r * hq, r * hp - p * hr, p * hq - q * hp])
        drag = np.zeros(2) if velocity_b is None else a.drag_per_s * velocity_b[:2]
        step = Balance(
            t_ns,
            dt * (-f_b[2] * a.mass_kg - wrench[0]),
            dt * thrusts,
            dt * torque,
            dt * (f_b[:2] + drag),
            momentum,
        )
        if last is not None:
            step = step._replace(
                force=last.force + step.force,
                thrusts=last.thrusts + step.thrusts,
                torque=last.torque + step.torque,
                lateral=last.lateral + step.lateral,
            )
        self._balances.append(step)
        self._judge(a, step)
        return np.asarray((torque + self._missing_torque) / self._inertia)

    def _judge(self, a: Airframe, now: Balance) -> None:
        """Hold what is missing over the window against what each fault would leave."""
        while len(self._balances) > 1 and self._balances[1].t_ns <= now.t_ns - WINDOW_NS:
            self._balances.popleft()
        then = self._balances[0]
        span = (now.t_ns - then.t_ns) / NS
        if now.t_ns - then.t_ns < 0.9 * WINDOW_NS:
            return
        thrusts = (now.thrusts - then.thrusts) / span
        if thrusts.sum() < WEAKEST * a.mass_kg * GRAVITY:
            self._flying_since_ns = None
        elif self._flying_since_ns is None:
            self._flying_since_ns = now.t_ns
        if self._flying_since_ns is None or now.t_ns - self._flying_since_ns < NS:
            for alarm in self._alarms.values():
                alarm.absent(now.t_ns)
            return
        missing = np.empty(4)
        missing[0] = (now.force - then.force) / span
        missing[1:] = (now.momentum - then.momentum - (now.torque - then.torque)) / span
        self._missing_torque = missing[1:]
        push = float(np.linalg.norm((now.lateral - then.lateral) / span))
        self._judge_motors(missing, thrusts, push, now.t_ns)
        alarm = self._alarms[FaultKind.GUST]
        if push > PUSH:
            alarm.found(now.t_ns, "", push, PUSH)
        else:
            alarm.absent(now.t_ns)

    def _judge_motors(self, missing: Array, thrusts: Array, push: float, t_ns: int) -> None:
        """One weak motor, or less lift on all: unless something pushes, which on a tilted vehicle lifts, too."""
        sigma = np.array(TRUST) * self._arms * thrusts.mean()
        sigma[0] *= len(thrusts)
        e = missing / sigma
        columns = -self._mixing * thrusts / sigma[:, None]  # what losing all of one motor would leave
        losses = (columns.T @ e) / (columns**2).sum(axis=0)
        costs = ((e[:, None] - losses * columns) ** 2).sum(axis=0)
        motor = int(np.argmin(costs))
        lifted = float(missing[0] / thrusts.sum())  # share of lift more than told
        torque = float(np.abs(missing[1:3] / (self._arms[1:3] * thrusts.mean())).max())
        one = losses[motor] > MOTOR_LOSS and costs[motor] < float((e[1:] ** 2).sum())
        alarm = self._alarms[FaultKind.MOTOR]
        if one:
            alarm.found(t_ns, f"motor {motor + 1}", float(losses[motor]), MOTOR_LOSS)
        else:
            alarm.absent(t_ns)
        mass = 1.0 / max(1.0 + lifted, 0.1)
        alarm = self._alarms[FaultKind.MASS]
        if not one and torque < TORQUE_CLEAR and push < 0.5 * PUSH and abs(mass - 1.0) > MASS_CHANGE:
            alarm.found(t_ns, "", mass, MASS_CHANGE / abs(mass - 1.0) * mass)
        else:
            alarm.absent(t_ns)

    # ------------------------------------------------------------------------------------ the sensors

    def take_innovation(self, measured: Measured, update: Update, outside: npt.NDArray[np.bool_]) -> None:
        """A measurement's innovation and which of its components were outside their layer. One that is outside,
        was small before, and is small after or as far to the other side, was a wrong value; else it is the
        model's."""
        # 1 or -1 outside, 0 well inside, else a half: neither
        near = np.abs(update.innovation) < NEAR * np.sqrt(np.diag(update.innovation_covariance))
        signs = np.where(outside, 1.0, 0.5) * np.sign(update.innovation) * ~near
        t_before, *before = self._signs.get(measured.sensor, (0, 0.0 * signs, 0.0 * signs))
        if len(before[1]) == len(signs):
            calm = (before[0] == 0) & ((signs == 0) | (signs == -before[1]))
            for i in np.flatnonzero(calm & (np.abs(before[1]) == 1)):
                self._wrong.append((t_before, f"{measured.sensor}.{measured.components[i]}"))
            self._signs[measured.sensor] = (measured.t_ns, before[1], signs)
        else:
            self._signs[measured.sensor] = (measured.t_ns, 0.0 * signs, signs)
        self._judge_sensors(measured.t_ns)

    def _judge_sensors(self, t_ns: int) -> None:
        """Wrong values are named once they are many, and once a fault of the vehicle, whose onset shakes the
        filter, has had the time to be named instead."""
        onsets = [alarm.fault.t_onset_ns for alarm in self._alarms.values() if alarm.fault is not None]
        shaken = [t for t in onsets if t_ns - t < 2 * NS]
        kept = [w for w in self._wrong if w[0] >= t_ns - 2 * NS]
        kept = [w for w in kept if not any(-SHAKEN_NS < w[0] - t < 2 * SHAKEN_NS for t in shaken)]
        self._wrong = deque(kept)
        recent = [w for w in kept if w[0] >= t_ns - NS]
        if not recent:
            if not kept:
                self._outliers = None
            return
        ripe = t_ns - min(t for t, _ in recent) > SHAKEN_NS
        if len(recent) >= WRONG_VALUES and ripe and self._outliers is None:
            part = Counter(name for _, name in recent).most_common(1)[0][0]
            self._outliers = Fault(
                kind=FaultKind.OUTLIERS,
                part=part,
                t_onset_ns=min(t for t, _ in recent),
                magnitude=float(len(recent)),
                unit="wrong values a second",
            )

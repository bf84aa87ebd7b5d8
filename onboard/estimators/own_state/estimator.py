"""Our own vehicle: position, velocity, attitude and rates from the autopilot's messages, by any of the filters.

The specific force drives the model of `models.own_motion`; attitude with body rates and GPS fixes correct it, each
at its own rate and at the time it was true, however late it comes. What the filter could not explain is counted,
and named where it can be (`_own_faults`).
"""

import math
from collections import deque
from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.history import History
from onboard.estimators.own_state import report as own_report
from onboard.estimators.own_state.config import Airframe, Config
from onboard.estimators.own_state.faults import FaultMonitor
from onboard.estimators.own_state.filters import Filtered, SensorFilter
from onboard.estimators.own_state.inputs import Inputs, Manoeuvres, Samples
from onboard.estimators.own_state.measurements import (
    BAROMETER,
    Measured,
    attitude_rows,
    from_attitude,
    from_barometer,
    from_fix,
    predicted,
)
from onboard.filters.belief import FilterError, NotPositiveDefiniteError, Update
from onboard.filters.gating import chi_square_threshold
from onboard.geometry.camera import Camera
from onboard.geometry.geodesy import geodetic_from_ned
from onboard.geometry.rotations import matrix_from_quaternion
from onboard.messages import (
    ActuatorOutputs,
    Attitude,
    Barometer,
    Estimate,
    GlobalPosition,
    GpsFix,
    Imu,
    Lifecycle,
    Message,
    Vec3,
    Verdict,
)
from onboard.models import own_motion
from onboard.models.quadrotor import ATTITUDE, POSITION, RATES, VELOCITY
from onboard.ownship import Ownship

__all__ = ["LISTENS", "Config", "Estimator"]

LISTENS: Final = (Attitude, Imu, Barometer, GpsFix, GlobalPosition, ActuatorOutputs)
NS: Final = 1_000_000_000
OFFSET_SIGMA: Final = 300.0  # m, of the barometer's datum over O
VELOCITIES: Final = np.ix_(VELOCITY, VELOCITY)
PATIENCE: Final = 2  # measurements in a row that a gate may reject
ATTITUDES: Final = 200  # kept, to begin with
LONGEST_STEP_NS: Final = 20_000_000
ORIGIN_WAIT_NS: Final = 2 * NS  # for a GLOBAL_POSITION_INT that tells where the autopilot's origin is
FIX_3D: Final = 3
NO_FORCE: Final = np.array([0.0, 0.0, -own_motion.GRAVITY])  # hovering, where no accelerometer is heard
NO_FORCE_NOISE: Final = 3.0  # m/s^2 per square root of Hz
NO_TURNING: Final = np.zeros(3)
NEW_DATUM: Final = np.full(own_motion.N, 1e-18)
NEW_DATUM[own_motion.OFFSET] = OFFSET_SIGMA**2
TURN_NOISE: Final = np.full(own_motion.N, 1e-18)


class Cell(NamedTuple):
    """What is believed: the filter's state, the attitude R_na of the frame its angles turn into, and the gate's
    memory."""

    R_na: Array
    filtered: Filtered
    rejected: Mapping[str, int]  # how many measurements in a row, by sensor


class Outcome(NamedTuple):
    """What the filter made of a measurement."""

    fused: bool
    update: Update


class Estimator:
    """See `onboard.estimators.EstimatorProtocol`. All state is in the fields below."""

    def __init__(self, config: Config, _camera: Camera) -> None:
        if not config.coast_after_s <= config.validity_timeout_s <= config.reset_timeout_s:
            raise ValueError("coast_after_s <= validity_timeout_s <= reset_timeout_s must hold")
        self._config = config
        self._airframe: Airframe | None = config.known_airframe()
        self._filter = SensorFilter(config.filter)
        self._is_smooth = "svsf" in config.filter
        self._noise, self._fading = _process_noise(config)
        self._inertia = np.array(self._airframe.inertia_kg_m2 if self._airframe else (1.0, 1.0, 1.0))
        self._monitor = FaultMonitor(self._airframe)
        self._counts = own_report.Counts(config.layer_sigmas)
        self._resets = self._sequence = 0
        self._history: History[Cell, Inputs] | None = None
        self._inputs = Inputs(Samples(3), Samples(3), Manoeuvres())
        self._attitudes: deque[Measured] = deque(maxlen=ATTITUDES)
        self._origin: Vec3 | None = None
        self._velocity_b: Array | None = None
        self._datum: float | None = None  # the first altitude of the barometer, m
        self._newest_ns = self._next_told_ns = self._next_pressure_ns = 0
        self._told_silence = False
        self._first_fix_ns: int | None = None
        self._last_fix_ns: int | None = None
        self._last_fused_ns: int | None = None
        self._why = "no GPS fix yet"

    # ----------------------------------------------------------------------- what the pipeline calls

    def observe(self, message: Message, ownship: Ownship) -> list[Estimate]:
        """Take one message; an estimate for each attitude due to be told, and for each fix."""
        match message:
            case Imu():
                self._take_force(message)
                if message.pressure_altitude is not None:
                    return self._take_pressure(message, message.pressure_altitude)
            case Barometer():
                return self._take_pressure(message, message.pressure_altitude)
            case ActuatorOutputs():
                self._monitor.take_outputs(message)
            case GlobalPosition():
                self._learn_origin(message, ownship)
            case Attitude():
                return self._take_attitude(message)
            case GpsFix():
                return self._take_fix(message, ownship)
        return []

    def tick(self, ownship: Ownship) -> list[Estimate]:
        """Nothing to do: our own messages drive this estimate. But silence is noticed."""
        silent = self._newest_ns and ownship.now_ns - self._newest_ns > self._config.silence_s * NS
        if silent and not self._told_silence:
            self._told_silence = True
            return [self._tell(None)]
        return []

    def reset(self, reason: str) -> None:
        """Forget everything: the time base or the origin is no longer what it was."""
        self._forget(reason)
        self._inputs = Inputs(Samples(3), Samples(3), Manoeuvres())
        self._attitudes.clear()
        self._origin = self._velocity_b = self._first_fix_ns = self._last_fix_ns = self._datum = None
        self._newest_ns = self._next_told_ns = self._next_pressure_ns = 0
        self._told_silence = False
        self._monitor.clear()

    # -------------------------------------------------------------------------------- messages' ways

    def _take_force(self, message: Imu) -> None:
        f_b, omega = np.array(message.f_b), np.array(message.omega_b)
        if not (np.isfinite(f_b).all() and np.isfinite(omega).all()):
            return
        if self._config.force == "thrust":
            f_b = np.array([0.0, 0.0, f_b[2]])
        if self._inputs.force.add(message.t_ns, f_b):
            turning = self._monitor.take_imu(message, self._velocity_b)
            if turning is not None:
                self._inputs.turning.add(message.t_ns, turning)

    def _take_pressure(self, message: Imu | Barometer, altitude: float) -> list[Estimate]:
        rate = self._config.pressure_rate_hz
        if rate == 0.0 or message.t_ns < self._next_pressure_ns:
            return []
        self._next_pressure_ns = message.t_ns + round(NS / rate) - NS // 1000
        if self._datum is None and math.isfinite(altitude):
            self._datum = altitude
        measured = from_barometer(message, altitude, self._datum or 0.0, self._config)
        if isinstance(measured, Verdict):
            return [self._tell(own_report.refused(message, BAROMETER, measured))]
        self._fuse_in(measured)
        return []

    def _learn_origin(self, message: GlobalPosition, ownship: Ownship) -> None:
        """Where the autopilot's own origin is, so that positions can be held against its own."""
        pose = ownship.pose_at(message.t_ns) if self._origin is None else None
        if pose is not None:
            place = (message.lat_deg, message.lon_deg, message.alt_msl)
            self._origin = geodetic_from_ned(-pose.r_OF_n, place)

    def _take_attitude(self, message: Attitude) -> list[Estimate]:
        measured = from_attitude(message, self._config)
        if isinstance(measured, Verdict):
            return [self._tell(own_report.refused(message, "attitude", measured))]
        if self._attitudes and message.t_ns <= self._attitudes[-1].t_ns:
            return []  # ATTITUDE and ATTITUDE_QUATERNION of one instant are the same attitude
        self._attitudes.append(measured)
        self._inputs.manoeuvres.add_attitude(measured.t_ns, matrix_from_quaternion(measured.q_nb))
        self._newest_ns, self._told_silence = message.t_ns, False
        outcome = self._fuse_in(measured)
        if message.t_ns < self._next_told_ns:
            return []
        self._next_told_ns = message.t_ns + round(NS / self._config.publish_rate_hz) - NS // 1000
        return [self._tell(own_report.report(measured, outcome))]

    def _take_fix(self, message: GpsFix, ownship: Ownship) -> list[Estimate]:
        if message.fix_type < FIX_3D or message.t_ns == self._last_fix_ns:
            return []
        self._last_fix_ns = message.t_ns
        if self._first_fix_ns is None:
            self._first_fix_ns = message.t_ns
        if self._origin is None:
            pose = ownship.pose_at(message.t_ns)
            if message.t_ns - self._first_fix_ns < ORIGIN_WAIT_NS:
                return []
            place = (message.lat_deg, message.lon_deg, message.alt_msl)
            self._origin = place if pose is None else geodetic_from_ned(-pose.r_OF_n, place)
        measured = from_fix(message, self._origin, self._config)
        if isinstance(measured, Verdict):
            return [self._tell(own_report.refused(message, "gps", measured))]
        self._inputs.manoeuvres.add_fix(measured.t_ns, measured.y[3:], np.sqrt(np.diag(measured.R)[3:]))
        if self._history is None:
            self._start(measured)
            return [self._tell(own_report.refused(message, "gps", Verdict.INITIALISING))]
        if message.t_ns > self._newest_ns + self._config.rewind_horizon_s * NS:
            return [self._tell(own_report.refused(message, "gps", Verdict.TOO_NEW))]
        if not self._history.reaches(message.t_ns):
            return [self._tell(own_report.refused(message, "gps", Verdict.TOO_OLD))]
        outcome = self._fuse_in(measured)
        if outcome is not None and outcome.fused:
            self._last_fused_ns = max(self._last_fused_ns or 0, message.t_ns)
        return [self._tell(own_report.report(measured, outcome))]

    # ------------------------------------------------------------------------------------ the filter

    def _start(self, fix: Measured) -> None:
        """Begin at a fix, with the attitude nearest to it; take up what attitudes have come since."""
        near = min(self._attitudes, key=lambda a: abs(a.t_ns - fix.t_ns), default=None)
        if near is None or abs(near.t_ns - fix.t_ns) > NS // 2:
            self._why = "no attitude at the time of the fix"
            return
        mean, P = np.zeros(own_motion.N), np.zeros(own_motion.N)
        mean[list(POSITION)], P[list(POSITION)] = fix.y[:3], np.diag(fix.R)[:3]
        mean[list(VELOCITY)] = np.append(fix.y[3:], np.zeros(6 - len(fix.y)))
        P[list(VELOCITY)] = np.append(np.diag(fix.R)[3:], np.full(6 - len(fix.y), 4.0))
        P[list(ATTITUDE)], P[list(RATES)] = 4 * np.diag(near.R)[:3], 4 * np.diag(near.R)[3:]
        mean[list(RATES)] = near.y[3:]
        P[list(own_motion.DISTURBANCE)] = self._disturbance_variance
        P[own_motion.OFFSET] = OFFSET_SIGMA**2
        R_na = matrix_from_quaternion(near.q_nb)
        cell = Cell(R_na, self._filter.start(mean, np.diag(P)), {})
        self._history = History(
            fix.t_ns,
            cell,
            horizon_ns=round(self._config.rewind_horizon_s * NS),
            advance=self._advance,
            fuse=self._fuse,
        )
        self._last_fused_ns = fix.t_ns
        self._why = ""
        for attitude in self._attitudes:
            if attitude.t_ns > fix.t_ns:
                self._fuse_in(attitude)

    def _fuse_in(self, measured: Measured) -> Outcome | None:
        """Put a measurement in where it belongs, and see what it says of the model. None: nothing is tracked."""
        if self._history is None or not self._history.reaches(measured.t_ns):
            return None
        try:
            self._history.settle(self._inputs)
            outcome: Outcome = self._history.insert(measured.t_ns, measured, self._inputs)
        except (NotPositiveDefiniteError, FilterError) as error:
            self._forget(f"numerical: {error}")
            return None
        outside = self._counts.add(measured, outcome.update)
        self._monitor.take_innovation(measured, outcome.update, outside)
        return outcome

    def _advance(self, cell: Cell, t0_ns: int, t1_ns: int, inputs: Inputs) -> Cell:
        pieces = -(-(t1_ns - t0_ns) // LONGEST_STEP_NS)
        for k in range(pieces):
            a_ns, b_ns = t0_ns + (t1_ns - t0_ns) * k // pieces, t0_ns + (t1_ns - t0_ns) * (k + 1) // pieces
            cell = self._step(cell, a_ns, b_ns, inputs)
        return cell

    def _step(self, cell: Cell, t0_ns: int, t1_ns: int, inputs: Inputs) -> Cell:
        dt = (t1_ns - t0_ns) * 1e-9
        force, turning = inputs.force.mean(t0_ns, t1_ns), inputs.turning.mean(t0_ns, t1_ns)
        Q = self._noise * dt
        if force is None:
            force = NO_FORCE
            Q[list(VELOCITY)] += NO_FORCE_NOISE**2 * dt
        spin = NO_TURNING if turning is None else turning
        # on a shaking vehicle the accelerometer is weighed against hovering, by what each tells of the true force
        density = inputs.force.density(t1_ns)
        manoeuvres = inputs.manoeuvres.at(t1_ns)
        weight = manoeuvres / (manoeuvres + density)
        force = NO_FORCE + weight * (force - NO_FORCE)
        spread = np.diag(Q)
        R_nb = cell.R_na @ own_motion.rotations(self._filter.belief(cell.filtered).mean[None])[0]
        spread[VELOCITIES] += (R_nb * (dt * weight * density)) @ R_nb.T
        filtered = self._filter.predict(
            cell.filtered,
            lambda rows: own_motion.process(rows, dt, force, spin, cell.R_na, self._inertia, self._fading),
            spread,
        )
        mean = self._filter.belief(filtered).mean
        if np.abs(mean[list(ATTITUDE)]).max() < own_motion.LARGEST:
            return cell._replace(filtered=filtered)
        R_ac = own_motion.rotations(mean[None])[0]
        turned = self._filter.predict(filtered, lambda rows: own_motion.turned(rows, R_ac.T), np.diag(TURN_NOISE))
        return cell._replace(R_na=cell.R_na @ R_ac, filtered=turned)

    def _fuse(self, cell: Cell, measured: Measured, _inputs: Inputs) -> tuple[Cell, Outcome]:
        y, angular = attitude_rows(measured, cell.R_na)
        args = measured.sensor, y, predicted(measured), measured.R, angular
        filtered, update = self._filter.update(cell.filtered, *args)
        is_barometer = measured.sensor == BAROMETER
        if self._is_smooth and not is_barometer:
            return cell._replace(filtered=filtered), Outcome(True, update)
        # a filter without layers has a gate before it; what is outside for long is no wrong value, but the model's
        gated = update.nis > chi_square_threshold(self._config.gate_probability, len(y))
        run = cell.rejected.get(measured.sensor, 0) + 1 if gated else 0
        if is_barometer and run > PATIENCE:
            # of a barometer it is another datum, and no motion of ours: a door, a gust, ground effect
            forgotten = self._filter.predict(cell.filtered, lambda rows: rows, np.diag(NEW_DATUM))
            filtered, update = self._filter.update(forgotten, *args)
            run = 0
        rejected = {**cell.rejected, measured.sensor: run}
        if gated and run <= PATIENCE:
            return cell._replace(rejected=rejected), Outcome(False, update)
        return Cell(cell.R_na, filtered, rejected), Outcome(True, update)

    @property
    def _disturbance_variance(self) -> float:
        return float(self._noise[own_motion.DISTURBANCE[0]] / (2 * self._fading))

    # --------------------------------------------------------------------------------- what is told

    def _forget(self, reason: str) -> None:
        if self._history is not None:
            self._resets += 1
        self._history = self._last_fused_ns = None
        self._why = reason
        self._counts.clear()

    def _age(self, t_ns: int) -> float:
        return float("inf") if self._last_fused_ns is None else max(t_ns - self._last_fused_ns, 0) / NS

    def _state(self, age: float) -> tuple[Lifecycle, str]:
        c = self._config
        if self._history is None:
            return (Lifecycle.SEARCHING if self._first_fix_ns is None else Lifecycle.INITIALISING), self._why
        if self._told_silence:
            return Lifecycle.LOST, "no attitude from the autopilot"
        if age <= c.coast_after_s:
            return Lifecycle.TRACKING, "fixes fused"
        if age <= c.validity_timeout_s:
            return Lifecycle.COASTING, "no fix fused lately: predicted"
        return Lifecycle.LOST, "no fix fused within the validity timeout"

    def _tell(self, measurement: own_report.Told | None) -> Estimate:
        age = self._age(self._newest_ns)
        if age > self._config.reset_timeout_s and self._history is not None:
            self._forget("no fix for longer than the reset timeout")
            age = float("inf")
        found = None
        if self._history is not None:
            t_ns, cell = self._history.belief_at(self._newest_ns, self._inputs)
            found = own_report.Found(t_ns, cell.R_na, self._filter.belief(cell.filtered))
        state, reason = self._state(age)
        self._sequence += 1
        estimate = own_report.nav_state(
            found,
            measurement,
            config=self._config,
            sequence=self._sequence,
            t_ns=self._newest_ns,
            life=(state, reason),
            age=age,
            resets=self._resets,
            origin=self._origin,
            counts=self._counts,
            faults=self._monitor.faults(),
        )
        if estimate.mean is not None and estimate.q_nb is not None:
            self._velocity_b = matrix_from_quaternion(estimate.q_nb).T @ np.array(estimate.mean[3:6])
        return estimate


def _process_noise(c: Config) -> tuple[Array, float]:
    """Process noise per second of each state (16,), and the rate (1/s) at which disturbances fade."""
    sigma, time = np.full(3, c.bias_sigma_m_s2), c.bias_time_s
    if c.force == "thrust":
        sigma, time = np.array([3.0, 3.0, c.bias_sigma_m_s2]), 1.0
    Q = np.zeros(own_motion.N)
    Q[list(POSITION)] = 1e-8
    Q[list(VELOCITY)] = c.force_noise**2
    Q[list(ATTITUDE)] = 1e-6
    Q[list(RATES)] = (c.turning_noise or (2.0 if c.airframe == "unknown" else 0.2)) ** 2
    Q[list(own_motion.DISTURBANCE)] = 2 * sigma**2 / time
    Q[own_motion.OFFSET] = c.pressure_drift**2
    return Q, 1.0 / time

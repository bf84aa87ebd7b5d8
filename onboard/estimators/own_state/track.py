"""The filter of our own state over time, from fix to fix.

Predictions are driven by the inputs, and updates are at the measurements' own times. The model is
`models.own_motion`. Its angles are relative to a reference frame a, which is moved to the vehicle's attitude
whenever an angle has grown too large.
"""

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.kit.history import History
from onboard.estimators.own_state.config import Config
from onboard.estimators.own_state.filters import FilterState, SensorFilter
from onboard.estimators.own_state.innovations import Contradiction, Counts, Innovation, innovation_of
from onboard.estimators.own_state.inputs import Inputs
from onboard.estimators.own_state.measurements import BAROMETER, GPS, Measurement, measurement_model, relative_to
from onboard.filters.belief import Belief, Update
from onboard.filters.gating import chi_square_threshold
from onboard.models import own_motion
from onboard.models.quadrotor import ATTITUDE, POSITION, RATES, VELOCITY
from onboard.units import NS_PER_S, S_PER_NS

DATUM_SIGMA: Final = 300.0  # m, of the barometer's datum above O
MAX_REJECTED_COUNT: Final = 2  # consecutive measurements that a gate may reject
MAX_STEP_NS: Final = 20_000_000
HOVERING_FORCE: Final = np.array([0.0, 0.0, -own_motion.GRAVITY])  # specific force without an accelerometer
HOVERING_NOISE: Final = 3.0  # m/s^2 per square root of Hz, of this specific force
NO_ACCELERATION: Final = np.zeros(3)
MIN_VARIANCE: Final = 1e-18  # keeps the process noise positive definite
# The same states as slices: a view takes a tenth of the time of an index array.
MOVING, TURNED, TURNING = (slice(states[0], states[-1] + 1, 2) for states in (VELOCITY, ATTITUDE, RATES))


class Cell(NamedTuple):
    """The content of a history node.

    Attributes
    ----------
    R_na
        Attitude of the reference frame of the angles.
    filtered
        The filter's state.
    rejected
        Number of consecutive measurements that the gate has rejected, by sensor.
    """

    R_na: Array
    filtered: FilterState
    rejected: Mapping[str, int]


class Posterior(NamedTuple):
    """A belief at a time, and the attitude R_na of the reference frame of its angles."""

    t_ns: int
    R_na: Array
    belief: Belief


class Track:
    """The filter from one fix on, started with the attitude near it.

    `counts` and `contradiction` evaluate its innovations.
    """

    def __init__(
        self, config: Config, sensor_filter: SensorFilter, inputs: Inputs, fix: Measurement, attitude: Measurement
    ) -> None:
        airframe = config.known_airframe()
        self._last_fix_ns = fix.t_ns  # the newest that was fused
        self.counts, self.contradiction = Counts(), Contradiction()
        self._gate_probability = config.gate_probability
        self._has_layer = "svsf" in config.filter
        self._inertia = np.array(airframe.inertia_kg_m2 if airframe else (1.0, 1.0, 1.0))
        self._noise, self._fading = process_noise(config)
        self._filter = sensor_filter
        self._inputs = inputs
        mean, variance = self._initial(fix, attitude)
        self._history: History[Cell, Inputs] = History(
            fix.t_ns,
            Cell(attitude.R_nb, sensor_filter.start(mean, np.diag(variance)), {}),
            horizon_ns=round(config.rewind_horizon_s * NS_PER_S),
            advance=self._advance,
            fuse=self._fuse,
        )

    def reaches(self, t_ns: int) -> bool:
        """Return whether a measurement of that time can still be inserted."""
        return self._history.reaches(t_ns)

    def insert(self, measurement: Measurement) -> Innovation:
        """Fuse a measurement at its own time, which must be within reach, and evaluate its innovation.

        Raises FilterError, NotPositiveDefiniteError; the track is then unusable.
        """
        self._history.settle(self._inputs)
        fused, update = self._history.insert(measurement.t_ns, measurement, self._inputs)
        if fused and measurement.sensor == GPS:
            self._last_fix_ns = max(self._last_fix_ns, measurement.t_ns)
        innovation = innovation_of(measurement, update, fused=fused)
        self.counts.add(innovation)
        self.contradiction.add(innovation)
        return innovation

    def age(self, t_ns: int) -> float:
        """Return the seconds since the newest fused fix."""
        return max(t_ns - self._last_fix_ns, 0) / NS_PER_S

    def posterior_at(self, t_ns: int) -> Posterior:
        """Return the newest belief, predicted to t_ns if that is later."""
        at_ns, cell = self._history.belief_at(t_ns, self._inputs)
        return Posterior(at_ns, cell.R_na, self._filter.belief(cell.filtered))

    def posterior_before(self, t_ns: int) -> Posterior | None:
        """Return the belief at a time from measurements until then; None before the history."""
        cell = self._history.belief_before(t_ns, self._inputs)
        return None if cell is None else Posterior(t_ns, cell.R_na, self._filter.belief(cell.filtered))

    def _initial(self, fix: Measurement, attitude: Measurement) -> tuple[Array, Array]:
        """Return mean and variances (16,). Velocity components that the fix lacks are 0 +- 2 m/s."""
        mean, variance = np.zeros(own_motion.STATE_SIZE), np.zeros(own_motion.STATE_SIZE)
        mean[list(POSITION)], variance[list(POSITION)] = fix.y[:3], np.diag(fix.R)[:3]
        missing = 6 - len(fix.y)
        mean[list(VELOCITY)] = np.append(fix.y[3:], np.zeros(missing))
        variance[list(VELOCITY)] = np.append(np.diag(fix.R)[3:], np.full(missing, 4.0))
        variance[list(ATTITUDE)], variance[list(RATES)] = np.split(4 * np.diag(attitude.R), 2)
        mean[list(RATES)] = attitude.y[3:]
        variance[list(own_motion.DISTURBANCE)] = self._noise[own_motion.DISTURBANCE[0]] / (2 * self._fading)
        variance[own_motion.OFFSET] = DATUM_SIGMA**2
        return mean, variance

    def _advance(self, cell: Cell, t0_ns: int, t1_ns: int, inputs: Inputs) -> Cell:
        steps = -(-(t1_ns - t0_ns) // MAX_STEP_NS)
        for k in range(steps):
            a_ns, b_ns = t0_ns + (t1_ns - t0_ns) * k // steps, t0_ns + (t1_ns - t0_ns) * (k + 1) // steps
            cell = self._recentre(self._step(cell, a_ns, b_ns, inputs))
        return cell

    def _step(self, cell: Cell, t0_ns: int, t1_ns: int, inputs: Inputs) -> Cell:
        dt = (t1_ns - t0_ns) * S_PER_NS
        force, acceleration = inputs.force.mean(t0_ns, t1_ns), inputs.angular_acceleration.mean(t0_ns, t1_ns)
        variance = self._noise * dt
        variance[TURNING] = inputs.noise.turning(t1_ns) * dt
        if force is None:
            force = HOVERING_FORCE
            variance[MOVING] += HOVERING_NOISE**2 * dt
        omega_dot = NO_ACCELERATION if acceleration is None else acceleration
        # On a shaking vehicle the accelerometer and the force of hovering are weighted by how well each is known.
        scatter = inputs.force.density(t1_ns)
        manoeuvres = inputs.manoeuvres.at(t1_ns)
        weight = manoeuvres / (manoeuvres + scatter)
        force = HOVERING_FORCE + weight * (force - HOVERING_FORCE)
        Q = np.diag(variance)
        R_nb = cell.R_na @ own_motion.rotations(self._filter.belief(cell.filtered).mean[None])[0]
        Q[MOVING, MOVING] += (R_nb * (dt * weight * scatter)) @ R_nb.T
        filtered = self._filter.predict(
            cell.filtered,
            lambda rows: own_motion.process(rows, dt, force, omega_dot, cell.R_na, self._inertia, self._fading),
            Q,
        )
        return Cell(cell.R_na, filtered, cell.rejected)

    def _recentre(self, cell: Cell) -> Cell:
        """Return the same state, relative to the present attitude if an angle has grown too large."""
        mean = self._filter.belief(cell.filtered).mean
        if np.abs(mean[TURNED]).max() < own_motion.MAX_REFERENCE_ANGLE:
            return cell
        R_ac = own_motion.rotations(mean[None])[0]
        no_noise = np.diag(np.full(own_motion.STATE_SIZE, MIN_VARIANCE))
        filtered = self._filter.predict(
            cell.filtered, lambda rows: own_motion.change_reference(rows, R_ac.T), no_noise
        )
        return cell._replace(R_na=cell.R_na @ R_ac, filtered=filtered)

    def _fuse(self, cell: Cell, measurement: Measurement, _inputs: Inputs) -> tuple[Cell, tuple[bool, Update]]:
        """Return the cell after a measurement, whether it was fused, and its update."""
        sensor = measurement.sensor
        y, angular = relative_to(cell.R_na, measurement)
        arguments = sensor, y, measurement_model(measurement), measurement.R, angular
        filtered, update = self._filter.update(cell.filtered, *arguments)
        if self._has_layer and sensor != BAROMETER:
            return Cell(cell.R_na, filtered, cell.rejected), (True, update)
        # A filter without layers has a gate before it. A run of rejections means that the model is wrong.
        gated = update.nis > chi_square_threshold(self._gate_probability, len(y))
        run = cell.rejected.get(sensor, 0) + 1 if gated else 0
        if sensor == BAROMETER and run > MAX_REJECTED_COUNT:
            # For a barometer it means another datum, not a motion of ours: a door, a gust, ground effect.
            filtered, update = self._filter.update(self._without_datum(cell.filtered), *arguments)
            run, gated = 0, False
        rejected = {**cell.rejected, sensor: run}
        if gated and run <= MAX_REJECTED_COUNT:
            return cell._replace(rejected=rejected), (False, update)
        return Cell(cell.R_na, filtered, rejected), (True, update)

    def _without_datum(self, filtered: FilterState) -> FilterState:
        variance = np.full(own_motion.STATE_SIZE, MIN_VARIANCE)
        variance[own_motion.OFFSET] = DATUM_SIGMA**2
        return self._filter.predict(filtered, lambda rows: rows, np.diag(variance))


def process_noise(c: Config) -> tuple[Array, float]:
    """Return the process noise per second, and the decay rate of disturbances, 1/s.

    The noise (16,) is that of all states but the rates, for which see `noise`.
    """
    sigma, time = np.full(3, c.bias_sigma_m_s2), c.bias_time_s
    if c.force == "thrust":
        sigma, time = np.array([3.0, 3.0, c.bias_sigma_m_s2]), 1.0
    variance = np.zeros(own_motion.STATE_SIZE)
    variance[list(POSITION)] = 1e-8
    variance[list(VELOCITY)] = c.force_noise**2
    variance[list(ATTITUDE)] = 1e-6
    variance[list(own_motion.DISTURBANCE)] = 2 * sigma**2 / time
    variance[own_motion.OFFSET] = c.pressure_drift**2
    return variance, 1.0 / time

"""What is told of our own state: the record, and the counts of what the filter could not explain."""

import math
from collections import deque
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from onboard.arrays import Array
from onboard.estimators.own_state.config import Config
from onboard.estimators.own_state.measurements import Measured
from onboard.filters.belief import Belief, Update
from onboard.geometry.rotations import euler_from_quaternion, quaternion_from_matrix
from onboard.messages import (
    Fault,
    Lifecycle,
    MeasurementReport,
    Message,
    NavState,
    Vec3,
    Verdict,
)
from onboard.models import own_motion
from onboard.models.quadrotor import POSITION, RATES, VELOCITY

NAME: Final = "own_state"
WINDOW_NS: Final = 1_000_000_000

Outside = npt.NDArray[np.bool_]
Told = tuple[MeasurementReport, tuple[float, ...] | None]


class Found(NamedTuple):
    """A belief and the attitude its angles turn into, at a time."""

    t_ns: int
    R_na: Array
    belief: Belief


class Counts:
    """Of the last second's measurements: how many components were outside their layer, and the NIS."""

    def __init__(self, sigmas: float) -> None:
        self._sigmas = sigmas
        self._seen: deque[tuple[int, int, int, float]] = deque()  # t, outside, components, NIS
        self._outside = self._components = 0  # of all that was seen

    def clear(self) -> None:
        """Forget them."""
        self._seen.clear()
        self._outside = self._components = 0

    def add(self, measured: Measured, update: Update) -> Outside:
        """Count a measurement; which of its components were outside (m,)."""
        layer = self._sigmas * np.sqrt(np.diag(update.innovation_covariance))
        outside: Outside = np.abs(update.innovation) > layer
        self._seen.append((measured.t_ns, int(outside.sum()), len(outside), float(update.nis)))
        self._outside += self._seen[-1][1]
        self._components += len(outside)
        while self._seen[0][0] < measured.t_ns - WINDOW_NS:
            _, gone, components, _ = self._seen.popleft()
            self._outside -= gone
            self._components -= components
        return outside

    @property
    def switch_fraction(self) -> float | None:
        """Share of components outside their layer."""
        return self._outside / self._components if self._components else None

    @property
    def nis_ratio(self) -> float | None:
        """NIS over the number of components: 1 where the covariance is right."""
        return sum(nis for _, _, _, nis in self._seen) / self._components if self._components else None


def refused(message: Message, sensor: str, verdict: Verdict) -> Told:
    """The report of a message that did not reach the filter."""
    return MeasurementReport(source=sensor, t_ns=message.t_ns, t_recv_ns=message.t_recv_ns, verdict=verdict), None


def report(measured: Measured, outcome: Any) -> Told:
    """A measurement's report, and its innovation's deviations; `outcome` is None before there is a state."""
    head: dict[str, Any] = {"source": measured.sensor, "t_ns": measured.t_ns, "t_recv_ns": measured.t_recv_ns}
    if outcome is None:
        return MeasurementReport(**head, verdict=Verdict.INITIALISING), None
    update: Update = outcome.update
    sigma = tuple(np.sqrt(np.diag(update.innovation_covariance)).tolist())
    measurement = MeasurementReport(
        **head,
        verdict=Verdict.FUSED if outcome.fused else Verdict.GATED,
        components=measured.components,
        units=measured.units,
        measured=tuple((update.predicted + update.innovation).tolist()),
        predicted=tuple(update.predicted.tolist()),
        innovation=tuple(update.innovation.tolist()),
        innovation_sigma=sigma,
        nis=float(update.nis),
    )
    return measurement, sigma


def nav_state(
    found: Found | None,
    told: Told | None,
    *,
    config: Config,
    sequence: int,
    t_ns: int,
    life: tuple[Lifecycle, str],
    age: float,
    resets: int,
    origin: Vec3 | None,
    counts: Counts,
    faults: tuple[Fault, ...],
) -> NavState:
    """The record. `told` is the newest measurement's report with its deviations; `age` is of the newest fix."""
    measurement, sigma = told if told is not None else (None, None)
    mean = covariance = q_nb = omega_b = None
    if found is not None:
        x, P = found.belief
        R_nb = found.R_na @ own_motion.rotations(x[None])[0]
        q = quaternion_from_matrix(R_nb)
        omega = x[list(RATES)]
        vector = (*x[list(POSITION)].tolist(), *x[list(VELOCITY)].tolist(), *euler_from_quaternion(q))
        mean = (*vector, *omega.tolist())
        q_nb, omega_b = tuple(q.tolist()), tuple(omega.tolist())
        spread = own_motion.told(P, x) + _steady(R_nb, config)
        covariance = tuple(tuple(row) for row in (0.5 * (spread + spread.T)).tolist())
    state, reason = life
    valid = found is not None and state in (Lifecycle.TRACKING, Lifecycle.COASTING)
    return NavState(
        name=NAME,
        target=NAME,
        sequence=sequence,
        t_ns=t_ns if found is None else found.t_ns,
        state=state,
        valid=valid,
        reason=reason,
        frame="n",
        components=own_motion.COMPONENTS,
        units=own_motion.UNITS,
        mean=mean,
        covariance=covariance,
        age=None if math.isinf(age) else age,
        reset_count=resets,
        measurement=measurement,
        q_nb=q_nb,
        omega_b=omega_b,
        origin=origin,
        layer=None if sigma is None else tuple(config.layer_sigmas * s for s in sigma),
        switch_fraction=counts.switch_fraction,
        nis_ratio=counts.nis_ratio,
        quality=_quality(counts, age, config) if valid else -1,
        faults=faults,
    )


def _steady(R_nb: Array, config: Config) -> Array:
    """Covariance (12, 12) of a steady error of the autopilot's attitude, which its messages cannot average out."""
    tilt, yaw = np.radians([config.own_tilt_sigma_deg, config.own_yaw_sigma_deg]) ** 2
    steady = np.zeros((12, 12))
    steady[6:9, 6:9] = R_nb.T @ np.diag([tilt, tilt, yaw]) @ R_nb
    return steady


def _quality(counts: Counts, age: float, config: Config) -> int:
    """Per cent: the share of measurements the filter can explain, less the longer there was no fix."""
    explained = 1.0 - (counts.switch_fraction or 0.0)
    fresh = 1.0 - max(age - config.coast_after_s, 0.0) / max(config.validity_timeout_s, 1e-9)
    return max(round(100 * explained * max(fresh, 0.0)), 1)

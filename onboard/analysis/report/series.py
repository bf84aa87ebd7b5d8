"""Series that a report needs of a flight, collected while it is replayed.

They are thinned to ten rows a second, so that an hour takes some megabytes.
"""

from array import array
from collections import Counter
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.geometry.rotations import euler_from_quaternion
from onboard.messages import Estimate, Fault, Lifecycle, MeasurementReport, NavState, Output, OwnPose, Verdict
from onboard.units import S_PER_NS

ROW_PERIOD_NS: Final = 100_000_000  # of each series
FUSED: Final = (Verdict.FUSED, Verdict.FUSED_LATE)
STARTING: Final = (Verdict.INITIALISING,)


class NumberRows:
    """Rows of numbers, appended one by one."""

    def __init__(self, width: int) -> None:
        self._width, self._values, self._last_ns = width, array("d"), -ROW_PERIOD_NS

    def is_due(self, t_ns: int) -> bool:
        """Whether a row is wanted by now. A clock that goes back starts again."""
        if 0 <= t_ns - self._last_ns < ROW_PERIOD_NS:
            return False
        self._last_ns = t_ns
        return True

    def append(self, *values: float) -> None:
        """Append a row."""
        self._values.extend(values)

    def table(self) -> Array:
        """All rows (n, width)."""
        return np.array(self._values).reshape(-1, self._width)


class RejectedImages(NamedTuple):
    """Images with one verdict: their number, first and last boot time (s)."""

    number: int
    first_s: float
    last_s: float


class FlightSeries:
    """One flight: times in s on the boot clock, positions in m, NED from the origin.

    `own`: time, position (3), velocity (3) m/s, roll, pitch and yaw (degrees) of our own vehicle, as the autopilot
    has them; north and east are NaN where not known. `leader`: time, 1 if valid, position (3) relative to us,
    1-sigma of the range; NaN where not valid. `images`: time, index of the verdict in `verdicts`, NIS or NaN, its
    degrees of freedom. `states`: time and index of the state in `Lifecycle`, when it changes. `own_state`: time,
    1 if valid, NIS over its expectation, velocity (3) or NaN."""

    def __init__(self, estimator: str) -> None:
        self.estimator = estimator
        self.own, self.leader, self.images = NumberRows(10), NumberRows(6), NumberRows(4)
        self.states, self.own_state = NumberRows(2), NumberRows(6)
        self._state: Lifecycle | None = None
        self.verdicts = tuple(Verdict)
        self.rejected: dict[Verdict, RejectedImages] = {}
        self.counts: Counter[Verdict] = Counter()
        self.faults: dict[tuple[str, str, int], Fault] = {}
        self.last_valid_s = self.first_valid_s = self.longest_gap_s = np.nan
        self.end_s = 0.0

    def add(self, output: Output) -> None:
        """Add the next output of the pipeline."""
        if isinstance(output, OwnPose):
            north, east, down = output.r_OF_n
            if self.own.is_due(output.t_ns):
                place = (np.nan if north is None else north, np.nan if east is None else east, down)
                angles = np.degrees(euler_from_quaternion(output.q_nb)).tolist()
                self.own.append(output.t_ns * S_PER_NS, *place, *output.v_F_n, *angles)
        elif isinstance(output, NavState):
            self._add_own_state(output)
        elif output.name == self.estimator and output.is_primary:
            self._add_leader(output)

    def _add_own_state(self, state: NavState) -> None:
        for fault in state.faults:
            self.faults[fault.kind, fault.part, fault.t_onset_ns] = fault
        if self.own_state.is_due(state.t_ns):
            ratio = np.nan if state.nis_ratio is None else state.nis_ratio
            known = state.valid and state.mean is not None
            velocity = state.mean[3:6] if known and state.mean is not None else (np.nan,) * 3
            self.own_state.append(state.t_ns * S_PER_NS, state.valid, ratio, *velocity)

    def _add_leader(self, estimate: Estimate) -> None:
        t = self.end_s = estimate.t_ns * S_PER_NS
        if estimate.measurement is not None:
            self._add_image(estimate.measurement)
        if estimate.state is not self._state:
            self._state = estimate.state
            self.states.append(t, list(Lifecycle).index(estimate.state))
        if estimate.valid:
            if not np.isnan(self.last_valid_s):
                self.longest_gap_s = np.nanmax([self.longest_gap_s, t - self.last_valid_s])
            self.first_valid_s = t if np.isnan(self.first_valid_s) else self.first_valid_s
            self.last_valid_s = t
        if not self.leader.is_due(estimate.t_ns):
            return
        if not estimate.valid or estimate.mean is None or estimate.covariance is None:
            self.leader.append(t, 0.0, np.nan, np.nan, np.nan, np.nan)
            return
        r, P = np.array(estimate.mean[:3]), np.array(estimate.covariance)[:3, :3]
        direction = r / max(float(np.linalg.norm(r)), 1e-9)
        self.leader.append(t, 1.0, *r.tolist(), float(np.sqrt(direction @ P @ direction)))

    def _add_image(self, image: MeasurementReport) -> None:
        t, verdict = image.t_ns * S_PER_NS, image.verdict
        self.counts[verdict] += 1
        fused = verdict in FUSED
        nis = image.nis if fused and image.nis is not None else np.nan
        self.images.append(t, self.verdicts.index(verdict), nis, len(image.components))
        if not fused and verdict not in STARTING:
            first = self.rejected[verdict].first_s if verdict in self.rejected else t
            self.rejected[verdict] = RejectedImages(self.counts[verdict], first, t)

"""Evaluation of innovations: consistency over the last second, lasting differences, and wrong values.

Every check reads the same record of a measurement. Innovations of a wrong model keep their sign; a single wrong
value's do not.
"""

from collections import Counter, deque
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.own_state.inputs import MANOEUVRE_DECAY_TIME_S, MAX_FIX_INTERVAL_NS
from onboard.estimators.own_state.measurements import GPS, Measurement
from onboard.filters.belief import Update
from onboard.messages import Fault, FaultKind
from onboard.units import NS_PER_S

LAYER_SIGMAS: Final = 5.0  # An innovation beyond so many standard deviations is a model error or an outlier.
MIN_WRONG_VALUE_COUNT: Final = 3  # per second, for a fault
MAX_NORMAL_SIGMAS: Final = 2.0  # of the innovations before and after a wrong value
ONSET_MARGIN_NS: Final = 400_000_000  # Near the onset of another fault, innovations do not show sensor faults.

COMPARISON_TIME_S: Final = 2 * MANOEUVRE_DECAY_TIME_S  # time constant of the comparison of fixes with the model
MIN_LASTING_VARIANCE_RATIO: Final = 1.0  # Of an innovation's variance; flights that fit the model have up to 0.6.
MIN_LASTING_VELOCITY_M_S: Final = 0.1  # A receiver's own error may last, too.


class Innovation(NamedTuple):
    """A measurement compared with its prediction.

    Attributes
    ----------
    fused
        Whether the measurement was fused.
    sigma
        Standard deviations (m,) of the innovation.
    ratio
        The innovation over these (m,).
    """

    measurement: Measurement
    update: Update
    fused: bool
    sigma: Array
    ratio: Array

    @property
    def outside(self) -> Any:
        """Which components are outside their layer, bool (m,)."""
        return np.abs(self.ratio) > LAYER_SIGMAS


def innovation_of(measurement: Measurement, update: Update, *, fused: bool) -> Innovation:
    """Return the record of an update."""
    sigma = np.sqrt(update.innovation_covariance.diagonal())
    return Innovation(measurement, update, fused, sigma, update.innovation / sigma)


class Counts:
    """Statistics of the last second's measurements."""

    def __init__(self) -> None:
        self._recent: deque[tuple[int, int, int, float]] = deque()  # t_ns, components, those outside, NIS

    def add(self, innovation: Innovation) -> None:
        """Count a measurement."""
        t_ns, outside = innovation.measurement.t_ns, innovation.outside
        self._recent.append((t_ns, len(outside), int(outside.sum()), float(innovation.update.nis)))
        while self._recent[0][0] < t_ns - NS_PER_S:
            self._recent.popleft()

    @property
    def switch_fraction(self) -> float | None:
        """Share of components outside their layer; None before the first."""
        return self._per_component(2)

    @property
    def nis_ratio(self) -> float | None:
        """NIS over the number of components: 1 if the covariance is right."""
        return self._per_component(3)

    def _per_component(self, column: int) -> float | None:
        components = sum(row[1] for row in self._recent)
        return sum(row[column] for row in self._recent) / components if components else None


class Contradiction:
    """Detector of a lasting difference between the velocities of fixes and of the model.

    The innovations of a filter with the right model are independent from fix to fix, so the mean product of two
    successive ones is 0. It is positive if the vehicle moves as the model does not expect, and if fixes are later
    than assumed: the velocity error is then many times the innovation, since the filter follows the fixes. NIS
    does not show it: most of it is the attitude's.
    """

    def __init__(self) -> None:
        self._last: tuple[int, Array, Array] | None = None  # time, innovation, and innovation over its sigma
        self._means = np.zeros(2)  # of the products: relative to the variance, and in m^2/s^2
        self._is_present = False

    @property
    def size(self) -> float | None:
        """Lasting part of a fix's velocity innovation, m/s; None while there is no contradiction."""
        return float(np.sqrt(max(self._means[1], 0.0))) if self._is_present else None

    def add(self, found: Innovation) -> None:
        """Add the innovation of a fused fix. A fix without velocity, or a late one, is ignored.

        A product is limited to `LAYER_SIGMAS`: one or two wrong fixes prove nothing.
        """
        measurement, t_ns, last = found.measurement, found.measurement.t_ns, self._last
        if not found.fused or measurement.sensor != GPS or len(measurement.y) < 5:
            return
        if last is not None and t_ns <= last[0]:
            return
        innovation, ratio = found.update.innovation[3:5], found.ratio[3:5]  # of the velocity to north and east
        self._last = t_ns, innovation, ratio
        if last is None or t_ns - last[0] > MAX_FIX_INTERVAL_NS:
            return
        share = min((t_ns - last[0]) / NS_PER_S / COMPARISON_TIME_S, 1.0)
        product = float(np.clip(np.mean(ratio * last[2]), -LAYER_SIGMAS, LAYER_SIGMAS))
        products = np.array([product, np.mean(innovation * last[1])])
        self._means += share * (products - self._means)
        enough = 0.5 * MIN_LASTING_VARIANCE_RATIO if self._is_present else MIN_LASTING_VARIANCE_RATIO
        self._is_present = bool(self._means[0] > enough and self._means[1] > MIN_LASTING_VELOCITY_M_S**2)


class OutlierMonitor:
    """Counts wrong values and reports a fault while they are many."""

    def __init__(self) -> None:
        self._fault: Fault | None = None
        self._signs: dict[str, tuple[int, Array, Array]] = {}  # by sensor: time, signs before it, signs then
        self._wrong: deque[tuple[int, str]] = deque()

    def faults(self) -> tuple[Fault, ...]:
        """Return the present fault, if there is one."""
        return () if self._fault is None else (self._fault,)

    def add(self, found: Innovation, onsets_ns: Sequence[int]) -> None:
        """Add a measurement's innovation.

        A component was a wrong value if it is outside its layer, was small before, and is small after or as large
        on the other side. Otherwise the model is wrong. `onsets_ns` are those of the vehicle's present faults.
        """
        # 1 or -1 outside, 0 well inside, 0.5 between
        is_large = np.abs(found.ratio) >= MAX_NORMAL_SIGMAS
        signs = np.where(found.outside, 1.0, 0.5) * np.sign(found.ratio) * is_large
        measurement, sensor, t_ns = found.measurement, found.measurement.sensor, found.measurement.t_ns
        last_ns, before, last = self._signs.get(sensor, (0, 0.0 * signs, 0.0 * signs))
        if len(last) == len(signs):
            single = (before == 0) & ((signs == 0) | (signs == -last))
            for i in np.flatnonzero(single & (np.abs(last) == 1)):
                self._wrong.append((last_ns, f"{sensor}.{measurement.components[i]}"))
            self._signs[sensor] = (t_ns, last, signs)
        else:
            self._signs[sensor] = (t_ns, 0.0 * signs, signs)
        self._update_fault(t_ns, onsets_ns)

    def _update_fault(self, t_ns: int, onsets_ns: Sequence[int]) -> None:
        """Raise a fault once there are many wrong values.

        The onset of a vehicle fault disturbs the filter, so such a fault is given the time to be reported instead.
        """
        shaken = [t for t in onsets_ns if t_ns - t < 2 * NS_PER_S]
        kept = [w for w in self._wrong if w[0] >= t_ns - 2 * NS_PER_S]
        kept = [w for w in kept if not any(-ONSET_MARGIN_NS < w[0] - t < 2 * ONSET_MARGIN_NS for t in shaken)]
        self._wrong = deque(kept)
        recent = [w for w in kept if w[0] >= t_ns - NS_PER_S]
        if not recent:
            if not kept:
                self._fault = None
            return
        onset_ns = min(t for t, _ in recent)
        if len(recent) >= MIN_WRONG_VALUE_COUNT and t_ns - onset_ns > ONSET_MARGIN_NS and self._fault is None:
            self._fault = Fault(
                kind=FaultKind.OUTLIERS,
                part=Counter(name for _, name in recent).most_common(1)[0][0],
                t_onset_ns=onset_ns,
                magnitude=float(len(recent)),
                unit="wrong values a second",
            )

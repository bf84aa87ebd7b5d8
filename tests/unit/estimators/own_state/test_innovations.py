"""Counts of the last second's innovations, and which of them are wrong values."""

import numpy as np
import pytest

from onboard.estimators.own_state.innovations import Counts, OutlierMonitor, innovation_of
from onboard.estimators.own_state.measurements import GPS, Measurement
from onboard.filters.belief import Belief, Update
from tests.support.own_vehicle import MS


def test_components_outside_are_counted_over_the_last_second_alone() -> None:
    """Two components every 0.4 s, the first one outside at first. By hand: older ones do not count."""
    counts, nothing = Counts(), np.zeros(2)
    assert counts.switch_fraction is None
    found = []
    for k, innovation in enumerate([6.0, 6.0, 0.0, 0.0, 0.0]):
        update = Update(Belief(nothing, np.eye(2)), np.array([innovation, 0.0]), np.eye(2), nothing, float(k))
        measurement = Measurement(GPS, 400 * k * MS, 400 * k * MS, nothing, np.eye(2))
        counts.add(innovation_of(measurement, update, fused=True))
        found.append((counts.switch_fraction, counts.nis_ratio))
    assert found == [(0.5, 0.0), (0.5, 0.25), (2 / 6, 0.5), (1 / 6, 1.0), (0.0, 1.5)]


ONSET_NS = 5_100 * MS


@pytest.mark.parametrize(
    ("ratios", "onsets_ns", "is_fault"),
    [
        ([0.0, 9.0] * 10, (), True),  # every second value is wrong
        ([0.0, 9.0, -9.0] * 7, (), True),  # one wrong value, and its way back
        ([0.0, 9.0, 9.0, 9.0] * 5, (), False),  # that lasts: the model is wrong
        ([3.0, 9.0] * 10, (), False),  # before it, innovations were not small
        ([0.0, 4.0] * 10, (), False),  # within the layer
        ([0.0] * 8 + [9.0] + [0.0] * 8, (), False),  # one alone
        ([0.0] * 10 + [0.0, 9.0] * 5, (ONSET_NS,), False),  # near the onset of a fault of the vehicle
    ],
)
def test_many_single_wrong_values_are_a_fault(
    ratios: list[float], onsets_ns: tuple[int, ...], is_fault: bool
) -> None:
    """Ten a second, from 4 s on."""
    monitor, found = OutlierMonitor(), False
    for k, ratio in enumerate(ratios):
        t_ns = 4000 * MS + 100 * k * MS
        update = Update(Belief(np.zeros(1), np.eye(1)), np.array([ratio]), np.eye(1), np.zeros(1), ratio**2)
        measurement = Measurement(GPS, t_ns, t_ns, np.zeros(1), np.eye(1))
        monitor.add(innovation_of(measurement, update, fused=True), onsets_ns)
        found = found or monitor.faults() != ()
    assert found is is_fault

"""Counts of the last second's innovations."""

import numpy as np

from onboard.estimators.own_state.innovations import Counts, innovation_of
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

"""Counts of the last second's innovations."""

import numpy as np

from onboard.estimators.own_state.innovations import Counts
from onboard.filters.belief import Belief, Update
from tests.support.own_vehicle import MS


def test_components_outside_are_counted_over_the_last_second_alone() -> None:
    """Two components every 0.4 s, the first one outside at first. By hand: older ones do not count."""
    counts, nothing = Counts(5.0), np.zeros(2)
    assert counts.switch_fraction is None
    found = []
    for k, innovation in enumerate([6.0, 6.0, 0.0, 0.0, 0.0]):
        update = Update(Belief(nothing, np.eye(2)), np.array([innovation, 0.0]), np.eye(2), nothing, float(k))
        counts.add(400 * k * MS, update)
        found.append((counts.switch_fraction, counts.nis_ratio))
    assert found == [(0.5, 0.0), (0.5, 0.25), (2 / 6, 0.5), (1 / 6, 1.0), (0.0, 1.5)]

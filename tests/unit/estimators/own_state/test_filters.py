"""Filters under several sensors."""

import numpy as np

from onboard.estimators.own_state.filters import SensorFilter


def test_each_sensor_has_its_own_memory_of_being_outside_seed_4() -> None:
    """Two sensors of two components each: rejections of one do not count for the other."""
    filters = SensorFilter("csvsf-robust")
    state = filters.start(np.zeros(4), np.eye(4) * 1e-2)
    R = 1e-4 * np.eye(2)
    far = np.array([50.0, 0.0])
    for _ in range(2):
        state, _ = filters.update(state, "a", far, lambda rows: rows[:, :2], R, ())
    state, _ = filters.update(state, "b", far, lambda rows: rows[:, 2:], R, ())
    assert np.abs(filters.belief(state).mean).max() < 1.0  # the third in a row, but not of one sensor
    state, _ = filters.update(state, "a", far, lambda rows: rows[:, :2], R, ())
    assert filters.belief(state).mean[0] > 49.0


def test_the_model_error_found_by_each_sensor_is_kept_apart() -> None:
    filters = SensorFilter("csvsf-adaptive")
    state = filters.start(np.zeros(2), np.eye(2))
    for sensor in ("a", "b"):
        state, _ = filters.update(state, sensor, np.zeros(1), lambda rows: rows[:, :1], np.eye(1), ())
    assert set(state.model_errors) == {"a", "b"}

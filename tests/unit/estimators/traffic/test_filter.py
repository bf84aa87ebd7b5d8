"""The filters of all tracks: modes of the mixture, and the batch."""

import numpy as np
import pytest

from onboard.estimators.traffic.batch import Batch, Radar
from onboard.estimators.traffic.config import FilterName
from onboard.estimators.traffic.filter import track_filter
from onboard.filters.belief import Belief
from onboard.models.intruder import measurement
from onboard.models.intruder.attitude_error import ReportErrors
from tests.support.intruder import ATTITUDE_ERROR, MODEL, R_RN, RADAR, beliefs


def test_modes_have_their_durations_and_change_to_any_other() -> None:
    durations = np.array([50.0, 15.0, 5.0])
    tracks = track_filter("imm", [MODEL] * 3, durations.tolist())
    no_reports = ReportErrors(np.full((1, 3), np.inf), np.zeros((1, 3, 3)))
    first = tracks.start(np.zeros((1, 15)), np.eye(15)[None])
    np.testing.assert_allclose(first.probabilities[0], durations / 70.0)
    np.testing.assert_allclose(
        tracks.predict(first, 3.0, ATTITUDE_ERROR, no_reports).probabilities[0], durations / 70.0
    )
    for k, rest in enumerate(np.eye(3)):
        one = first._replace(probabilities=rest[None])
        after = tracks.predict(one, 0.01, ATTITUDE_ERROR, no_reports).probabilities[0]
        left = 0.01 / durations[k]
        np.testing.assert_allclose(after, np.where(rest, 1.0 - left, left / 2), rtol=2e-3)


@pytest.mark.parametrize("name", ["kf", "ekf", "srukf", "imm"])
def test_a_belief_in_which_some_tracks_are_replaced_is_that_of_the_whole_state_seed_4(name: FilterName) -> None:
    mean, covariance = beliefs(4, seed=4)
    batch = Batch(track_filter(name, [MODEL, MODEL._replace(acceleration=np.ones(3))], [50.0, 5.0]))
    for row in range(4):
        batch.add(Belief(mean[row], covariance[row]))
    before, rows = batch.belief(), np.array([2, 0, 3])
    polar = measurement.echo(mean[rows], np.zeros(3), RADAR, R_RN)
    updates = batch.evaluate_echoes(rows, 0.0, polar, np.tile([5.0, 0.01, 0.01], (3, 1)), Radar(RADAR, R_RN))
    batch.apply(rows, updates, np.array([2, 0]))
    batch.restart(0, Belief(mean[1], covariance[1]))
    kept = batch.belief()
    batch._set(batch._state)
    for array, anew in zip(kept, batch.belief(), strict=True):
        np.testing.assert_array_equal(array, anew)
    np.testing.assert_array_equal(kept.mean[1], before.mean[1])
    np.testing.assert_allclose(kept.mean[0], mean[1])
    assert np.trace(kept.covariance[3, :3, :3]) < np.trace(before.covariance[3, :3, :3])

"""The leader as one belief: what it expects of an image, what passes, and how many hypotheses it keeps."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from onboard.estimators.leader.config import Config
from onboard.estimators.leader.hypotheses import motion, update
from onboard.estimators.leader.hypotheses.belief import BeliefFilter, State, make_filter
from onboard.estimators.leader.image.camera_pose import CameraPose
from onboard.estimators.leader.image.measurement import points_of
from onboard.estimators.leader.reports.prior import Prior
from onboard.filters.belief import Belief, FilterError
from onboard.models.relative_motion import POSITION, VELOCITY
from onboard.ownship import Step
from tests.support.images import fused
from tests.unit.estimators.leader.hypotheses.test_headings import image

STILL = CameraPose(np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3))
DT = 1.0 / 30.0


def filter_of(**section: Any) -> BeliefFilter:
    return make_filter(Config(size_prior_m=2.0, **section))


def step(moved: float) -> Step:
    """We move by this many metres to the east within DT."""
    v = np.array([0.0, moved / DT, 0.0])
    return Step(DT, v, v, np.zeros(3))


def watched(filter_: BeliefFilter, seconds: float, *, sway: float) -> tuple[State, list[float]]:
    """The state, and each image's NIS, after watching a leader 25 m away that hovers, its heading 40 degrees off
    the line of sight, while we sway by `sway` m, with a period of 4 s."""
    state = filter_.start(image(25.0, 0.7), STILL, None)
    east, nis = 0.0, []
    for k in range(1, round(seconds / DT) + 1):
        new = sway * math.sin(2.0 * math.pi * k * DT / 4.0)
        state, east = filter_.advance(state, step(new - east)), new
        update = fused(filter_, state, image(25.0, 0.7, east=east, seed=k), STILL)
        assert update.passes
        state = update.belief
        nis.append(update.nis)
    return state, nis


def test_the_range_is_found_by_our_own_motion_and_the_nis_is_as_expected() -> None:
    state, nis = watched(filter_of(), 10.0, sway=3.0)
    belief = filter_of().belief(state)
    r, P = belief.mean[POSITION], belief.covariance[POSITION, POSITION]
    range_ = float(np.linalg.norm(r))
    sigma = math.sqrt(r @ P @ r) / range_
    assert abs(range_ - math.hypot(25.0, 0.0)) < 2.0 * sigma < 7.6
    assert 2.5 < np.mean(nis[60:]) < 5.0  # of 4


@pytest.mark.parametrize(("speed", "flew"), [(5.0, True), (0.8, False)])
def test_a_leader_that_flew_when_an_earlier_run_ended_hardly_hovers(speed: float, flew: bool) -> None:
    """Its velocity may be any by now. Of a hover the prior says more than of a flight, so that hypotheses of one
    that hovers won: 23 m off 8 s later, by five deviations."""
    filter_, sigmas = filter_of(), np.array([1.0, 1.0, 0.5, 0.5, 0.5, 0.3])
    state = filter_.start(image(25.0, 0.7), STILL, None)
    known = Prior(0, np.array([25.0, 0.0, 0.0]), np.array([0.0, speed, 0.0]), np.zeros(3), np.diag(sigmas**2))
    assert known.flew is flew
    belief = Belief(np.array([25.0, 0.0, 0.0, 0.0, speed, 0.0]), np.diag([29.0, 29.0, 9.0, 9.6, 9.6, 2.0]))
    after = filter_.informed(state, belief, flew=known.flew)
    assert after is not None
    hovering = float(np.exp(after.particles.log_weights[after.particles.regimes == motion.HOVERING]).sum())
    assert hovering == pytest.approx(0.05) if flew else hovering > 0.6


def test_a_gated_image_reports_what_gated_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """All together may expect an image that most of them do not."""
    filter_ = filter_of()
    state = filter_.start(image(25.0, 0.7), STILL, None)
    monkeypatch.setattr(update, "update", lambda _settings, particles, *_: (particles, 40.0))
    after = fused(filter_, state, image(25.0, 0.7), STILL)
    assert (after.passes, after.nis) == (False, 40.0)


def test_an_image_that_nothing_expected_does_not_pass_and_changes_nothing() -> None:
    filter_ = filter_of()
    state, _ = watched(filter_, 4.0, sway=2.0)
    update = fused(filter_, state, image(25.0, 0.7, east=15.0), STILL)
    assert not update.passes
    assert update.nis > filter_.gate
    assert update.belief is state


def test_the_nis_is_the_innovations_own_whichever_names_the_wingtips_have() -> None:
    filter_ = filter_of()
    state, _ = watched(filter_, 4.0, sway=2.0)
    updates = [fused(filter_, state, image(25.0, 0.7, seed=7, swap=swap), STILL) for swap in (False, True)]
    for found in updates:
        e, S = found.innovation, found.innovation_covariance
        assert found.nis == pytest.approx(e @ np.linalg.solve(S, e))
    assert updates[0].nis == pytest.approx(updates[1].nis, rel=1e-9)


def test_a_delay_is_considered_in_the_place_and_in_what_a_turning_camera_measures() -> None:
    exact, late = filter_of(), filter_of(delay_sigma_s=0.1)
    state = exact.start(image(25.0, 0.0), STILL._replace(v_F_n=np.array([0.0, 5.0, 0.0])), None)
    state = state._replace(since=state.since._replace(v_F_n=np.array([0.0, -5.0, 0.0])))
    v = exact.belief(state).mean[VELOCITY]
    added = late.belief(state).covariance[POSITION, POSITION] - exact.belief(state).covariance[POSITION, POSITION]
    assert v[1] == pytest.approx(8.0, abs=1.0)  # some hypotheses hover
    assert_allclose(added, 0.01 * np.outer(v, v), atol=1e-12)
    turning = STILL._replace(omega_c=np.array([0.0, 0.0, 1.0]))
    S = [fused(f, state, image(25.0, 0.0), turning).innovation_covariance for f in (exact, late)]
    assert S[1][0, 0] - S[0][0, 0] == pytest.approx(0.01, rel=0.02)


def test_the_points_of_what_is_predicted_are_where_the_leader_is() -> None:
    filter_ = filter_of()
    state, _ = watched(filter_, 8.0, sway=3.0)
    seen = image(25.0, 0.7, seed=900)
    update = fused(filter_, state, seen, STILL)
    points = points_of(seen.axes, update.predicted)
    assert points[0] == pytest.approx([0.0, 0.0], abs=0.004)
    half = math.cos(0.7) / 25.0
    assert abs(points[2][0] - points[1][0]) == pytest.approx(2.0 * half, rel=0.1)
    assert np.isnan(points_of(-np.eye(3), np.zeros(4))).all()


def test_hypotheses_without_numbers_are_an_error() -> None:
    filter_ = filter_of()
    state = filter_.start(image(25.0, 0.3), STILL, None)
    state.particles.means[:] = math.nan
    with pytest.raises(FilterError, match="lost their numbers"):
        fused(filter_, state, image(25.0, 0.3), STILL)


def test_a_hypothesis_that_is_far_off_does_not_make_an_image_unlikely() -> None:
    """After seconds without an image one in a thousand may be almost at the camera: an innovation's covariance is
    that of all together, and a track that was right then gave its image to another one."""
    filter_, measurement = filter_of(), image(25.0, 0.7)
    state, _ = watched(filter_, 4.0, sway=2.0)
    least = int(np.argmin(state.particles.log_weights))
    means, log_weights = state.particles.means.copy(), state.particles.log_weights.copy()
    means[least, :3], log_weights[least] = [0.3, 0.0, 0.0], -7.0
    strayed = state._replace(particles=state.particles._replace(means=means, log_weights=log_weights))
    before, after = (filter_.compare(filter_.predict(s), measurement, STILL) for s in (state, strayed))
    assert np.linalg.slogdet(after.expected.S)[1] > np.linalg.slogdet(before.expected.S)[1] + 10.0
    assert after.cost == pytest.approx(before.cost, abs=0.1)

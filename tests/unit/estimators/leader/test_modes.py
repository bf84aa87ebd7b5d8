"""The compiled steps of all modes at once, compared with the same filter composed of its parts."""

from functools import partial

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.estimators.leader.filters import modes as compiled
from onboard.estimators.leader.filters import wing_line as _wing_line
from onboard.estimators.leader.filters.modes import Modes
from onboard.estimators.leader.filters.wing_line import Filter
from onboard.estimators.leader.filters.wing_line_noise import Extras
from onboard.estimators.leader.settings import FIXED_WING, MULTIROTOR
from onboard.filters import multiple_model, unscented
from onboard.filters.belief import FilterError, NotPositiveDefiniteError
from onboard.geometry.rotations import matrix_from_euler
from onboard.models import leader_flight, wing_line
from onboard.models.leader_flight import ImageGeometry, ModeParameters
from onboard.models.relative_motion import SIZE

DT = 0.02
BOTH = Extras(0.1, (0.005, 0.005, 0.02))
FILTERS = (
    Filter(2.0, 0.04, FIXED_WING),
    Filter(2.0, 0.04, MULTIROTOR, BOTH),
    Filter(2.0, 0.04, MULTIROTOR, BOTH._replace(own_velocity=0.1, middle=True)),  # may hover: five modes
)


def images(rng: np.random.Generator, count: int, m: int) -> tuple[Array, Array, ImageGeometry]:
    """y, R and geometry of `count` targets, some with their wingtips exchanged."""
    center = rng.uniform(-0.2, 0.2, (count, 1, 2))
    half = np.array([[[0.0, 0.0], [-0.04, 0.01], [0.04, -0.01]]])
    points = center + half * rng.choice([-1.0, 1.0], (count, 1, 1)) + rng.normal(size=(count, 3, 2)) * 1e-3
    y, R_y, axes = wing_line.from_points(points, rng.uniform(0.5e-3, 2e-3, (count, 3)), m)
    R_cn = np.array([matrix_from_euler(*rng.uniform(-0.2, 0.2, 3)).T for _ in range(count)])
    vectors = rng.normal(size=(3, count, 3))
    return y, R_y, ImageGeometry(R_cn, 0.1 * vectors[0], 5.0 * vectors[1], 0.1 * vectors[2], axes)


def by_parts(own: Filter, state: Modes, a: Array, image: tuple[Array, Array, ImageGeometry]) -> list[Array]:
    """A prediction and an update by `multiple_model`, which takes any filter and any model."""
    (y, R_y, geometry), r = image, state.probabilities.shape[1]
    weights = unscented.julier_weights(own.extras.states, float(own.extras.states))
    methods = [unscented.method("any", lambda _: weights, considered=(SIZE,))] * r
    modes = multiple_model.ModesState(
        tuple(methods[0].start(state.means[:, j].copy(), state.covariances[:, j].copy()) for j in range(r)),
        state.probabilities,
    )
    step = _wing_line._step(own, round(DT * 1e6))
    processes = [
        partial(
            leader_flight.process, dt=DT, v_F_n=geometry.v_F_n, a_F_n=a, parameters=ModeParameters(*row.tolist())
        )
        for row in step.parameters
    ]
    modes = multiple_model.predict(methods, modes, processes, step.noises, step.transition)
    measure = partial(leader_flight.measure, geometry=geometry, eps=own.model.hover_speed, m=own.m)
    if own.extras.delay > 0:
        means, covariances = (
            np.stack([s.mean for s in modes.states], 1),
            np.stack([s.covariance for s in modes.states], 1),
        )
        R_y = R_y + _wing_line._delay_noise(Modes(means, covariances, modes.probabilities), geometry, own.m)
    swapped = np.sum(y[:, 2:4] * measure(modes.states[0].mean)[:, 2:4], axis=1) < 0
    y, R_y = y.copy(), R_y.copy()
    y[swapped, 2:4] *= -1
    R_y[swapped, 2:4] *= -1
    R_y[swapped, :, 2:4] *= -1
    update = multiple_model.update(methods, modes, y, [measure] * r, R_y)
    mixture = multiple_model.belief(methods, update.belief)
    each = update.belief.states
    return [
        *mixture,
        np.stack([b.mean for b in each], 1),
        np.stack([b.covariance for b in each], 1),
        update.belief.probabilities,
        update.innovation,
        update.innovation_covariance,
        update.predicted,
        update.nis,
    ]


@pytest.mark.parametrize("own", FILTERS)
@pytest.mark.parametrize("count", [1, 3])
def test_a_step_of_all_modes_is_what_the_parts_make_seed_1(own: Filter, count: int) -> None:
    rng = np.random.default_rng(1)
    y, R_y, geometry = images(rng, count, own.m)
    state = _wing_line.start(own, y, R_y, geometry)
    for _ in range(20):
        image, a = images(rng, count, own.m), rng.normal(size=(count, 3))
        expected = by_parts(own, state, a, image)
        state = _wing_line.advance(own, state, DT, image[2].v_F_n, a)
        update = _wing_line.fuse(own, state, *image)
        state = update.belief
        got = [*compiled.mixture(state), *state, *update[1:5]]
        for a_, b_ in zip(got, expected, strict=True):
            np.testing.assert_allclose(a_, b_, rtol=1e-9, atol=1e-12)


def test_predicted_points_are_those_of_the_mean_of_all_modes_seed_4() -> None:
    """Where the view draws the prediction: by the measurement's own model, and nowhere behind the camera."""
    own, rng = FILTERS[0], np.random.default_rng(4)
    y, R_y, geometry = images(rng, 3, own.m)
    state = _wing_line.start(own, y, R_y, geometry)
    means = state.means + rng.normal(size=state.means.shape) * 0.5
    weights = np.array([[0.7, 0.3], [0.2, 0.8], [1.0, 0.0]])
    mean = np.sum(weights[:, :, None] * means, axis=1)
    eps = own.model.hover_speed
    points = compiled.predicted_points(Modes(means, state.covariances, weights), geometry, eps)
    wing = [leader_flight.wing_axis(m, *(m[3:6] + v), eps) for m, v in zip(mean, geometry.v_F_n, strict=True)]
    for p, side in enumerate((0.0, -0.5, 0.5)):
        tip = mean[:, :3] + side * mean[:, [SIZE]] * np.array(wing) - geometry.r_FC_n
        ahead, right, down = np.einsum("bij,bj->ib", geometry.R_cn, tip)
        np.testing.assert_allclose(points[:, p], np.stack([right / ahead, down / ahead], axis=1), rtol=1e-9)
    behind = Modes(-means, state.covariances, weights)
    assert np.isnan(compiled.predicted_points(behind, geometry, eps)).all()


def test_one_of_a_batch_is_what_it_is_alone_seed_2() -> None:
    own, rng = FILTERS[1], np.random.default_rng(2)
    image, a = images(rng, 4, own.m), rng.normal(size=(4, 3))
    state = _wing_line.start(own, *image)
    together = _wing_line.fuse(own, _wing_line.advance(own, state, DT, image[2].v_F_n, a), *image)
    for b in range(4):
        one = [b]
        y, R_y, geometry = image[0][one], image[1][one], ImageGeometry(*(array[one] for array in image[2]))
        alone = _wing_line.advance(own, Modes(*(array[one] for array in state)), DT, geometry.v_F_n, a[one])
        update = _wing_line.fuse(own, alone, y, R_y, geometry)
        for a_, b_ in zip([*together.belief, *together[1:5]], [*update.belief, *update[1:5]], strict=True):
            np.testing.assert_array_equal(a_[one], b_)


def test_what_cannot_be_done_is_refused_with_its_reason_seed_3() -> None:
    own, rng = FILTERS[0], np.random.default_rng(3)
    (y, R_y, geometry), none = images(rng, 2, own.m), np.zeros((2, 3))
    state = _wing_line.start(own, y, R_y, geometry)
    with pytest.raises(FilterError, match="shapes do not fit"):
        _wing_line.advance(own, state, DT, none[:1], none)
    with pytest.raises(FilterError, match="shapes do not fit"):
        _wing_line.fuse(own, state, y[:1], R_y, geometry)
    with pytest.raises(FilterError, match="y: not finite"):
        _wing_line.fuse(own, state, y * np.nan, R_y, geometry)
    lost = state._replace(covariances=-state.covariances)
    with pytest.raises(NotPositiveDefiniteError):
        _wing_line.advance(own, lost, DT, none, none)
    with pytest.raises(NotPositiveDefiniteError):
        _wing_line.fuse(own, lost, y, R_y, geometry)

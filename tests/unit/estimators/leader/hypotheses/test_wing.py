"""A leader with a given heading: its image and its motion, against plain geometry and a plain Kalman filter."""

import math

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.estimators.leader import assumptions
from onboard.estimators.leader.hypotheses import motion as model
from onboard.estimators.leader.hypotheses import view
from onboard.estimators.leader.hypotheses.prediction import ParticleArrays
from onboard.estimators.leader.image.measurement import measure_wing
from onboard.geometry.rotations import matrix_from_euler

SIZE, F_PX = 2.0, 500.0
Camera = tuple[Array, Array, Array]


def fly_on(
    means: Array,
    P: Array,
    headings: Array,
    regimes: Array,
    intensities: Array,
    drags: Array,
    step: model.Interval,
    course_locked: Array,
) -> None:
    """Each particle after a step, in place."""
    rest = regimes, means, P, intensities, course_locked, drags, np.zeros(len(headings))
    particles = ParticleArrays(headings, np.zeros(len(headings)), *rest)
    for k in range(len(headings)):
        model.fly_on(k, particles, step, assumptions.MIN_VISIBLE_FRACTION)


LEVEL = [(0.0, 0.0), (-0.04, 0.0), (0.04, 0.0)]
NOISE = np.diag([1.0, 1.0, 2.0, 2.0, 1.5, 1.5]) / F_PX**2


def wing(force: Array, heading: float, error: float) -> Array:
    """From the left wingtip to the right one, of a wing square to the thrust, which has this `force` against the
    weight and acceleration (3,) in n, m/s^2."""
    right = np.array([-math.sin(heading), math.cos(heading), 0.0])
    bank = math.atan2(float(force @ right), model.G - force[2]) + error
    return math.cos(bank) * right + np.array([0.0, 0.0, math.sin(bank)])


def seen(x: Array, heading: float, R_cn: Array, *, exchanged: bool = False) -> tuple[Array, Array]:
    """The measurement (6,) of a state (N,), without noise, and its axes."""
    force = x[model.ACCELERATION] + np.append(x[model.TILT], 0.0)
    half = (
        0.5 * math.exp(x[model.WING_SCALE_ERROR] + x[model.LOG_SIZE]) * wing(force, heading, x[model.BANK_ERROR])
    )
    signs = (0.0, 1.0, -1.0) if exchanged else (0.0, -1.0, 1.0)
    points = np.array([p[1:] / p[0] for p in (R_cn @ (x[model.POSITION] + k * half) for k in signs)])
    measured = measure_wing(points.tolist(), [1.0 / F_PX] * 3, middle=True)
    return measured.y, measured.axes


def foreseen(
    means: Array,
    P: Array,
    headings: Array,
    w: Array,
    y: Array,
    camera: tuple[Array, Array, Array],
    course_locked: Array,
) -> tuple[Array, Array, view.ImageRows, view.Expectation]:
    """What particles expect of a wing at y (m,): mean and covariance, without noise; the view, and what each
    expects."""
    m, rows = len(y), measure_wing(LEVEL, [1.0 / F_PX] * 3, middle=True).rows
    rows = rows._replace(y=y, R=NOISE[:m, :m].copy(), of=rows.of[:m], shares=rows.shares[:m], axis=rows.axis[:m])
    seen = view.view_of(rows, camera, course_locked)
    mean, _, S, _, each = view.expect(means, P, headings, w, seen)
    return mean, S - seen.R, seen, each


QUIET = model.Noise(np.zeros(model.N), np.zeros((3, model.N)), np.zeros(model.N), 0.0, 0.0)
ALIKE = np.zeros((1, 3))  # intensities
FREE, COURSE_LOCKED = (np.full(1, kind) for kind in (model.FREE, model.COURSE_LOCKED))
AT_REST = model.Hover(0.5, 0.1, 0.03, 0.02)
STEP = model.Interval(0.1, np.zeros(3), QUIET, AT_REST, np.ones(3))


def drawn(seed: int) -> tuple[Array, Array, float, Array]:
    """A state, its covariance, its heading and an attitude of the camera."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=model.N) * np.repeat([1.0, 3.0, 1.0, 0.05, 1.0, 0.02], [3, 3, 3, 1, 2, 2])
    x[model.POSITION] += [25.0, 4.0, -3.0]
    x[model.LOG_SIZE] += math.log(SIZE)
    L = 0.1 * np.tril(rng.normal(size=(model.N, model.N))) + 0.1 * np.eye(model.N)
    return x, L @ L.T, rng.uniform(-0.8, 0.8), matrix_from_euler(0.05, -0.1, 0.2).T


def corrected(
    x: Array, P: Array, heading: float, y: Array, axes: Array, R_cn: Array, course_locked: Array = FREE
) -> tuple[Array, Array, float]:
    """Mean, covariance and NIS of one particle after an image."""
    means, covariances = x[None].copy(), P[None].copy()
    camera = R_cn, np.zeros(3), axes
    headings = np.array([heading])
    *_, rows, each = foreseen(means, covariances, headings, np.ones(1), y, camera, course_locked)
    nis, _ = view.update(means, covariances, headings, rows, each)
    return means[0], covariances[0], float(nis[0])


@pytest.mark.parametrize("seed", range(5))
def test_an_image_as_predicted_has_no_nis_and_exchanged_tips_are_no_difference_seed_0_to_4(seed: int) -> None:
    x, P, heading, R_cn = drawn(seed)
    for exchanged in (False, True):
        mean, _, nis = corrected(x, P, heading, *seen(x, heading, R_cn, exchanged=exchanged), R_cn)
        assert nis == pytest.approx(0.0, abs=1e-9)
        assert mean == pytest.approx(x, abs=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_an_update_is_that_of_a_plain_kalman_filter_seed_0_to_4(seed: int) -> None:
    x, P, heading, R_cn = drawn(seed)
    predicted, axes = seen(x, heading, R_cn)
    y = predicted + 0.01 * np.random.default_rng(seed).normal(size=6) / F_PX  # a logarithm's line is that near by
    J = np.empty((6, model.N))
    for i, step in enumerate(1e-5 * np.eye(model.N)):
        J[:, i] = (shown(x + step, heading, R_cn, axes) - shown(x - step, heading, R_cn, axes)) / 2e-5
    e = y - predicted
    expected, its_covariance, S = plain(x, P, J, e)
    mean, covariance, nis = corrected(x, P, heading, y, axes, R_cn)
    assert nis == pytest.approx(e @ np.linalg.solve(S, e), rel=1e-3)
    assert mean == pytest.approx(expected, abs=2e-4)
    assert covariance == pytest.approx(its_covariance, abs=2e-4)
    particle, camera = (x[None].copy(), P[None].copy(), np.array([heading])), (R_cn, np.zeros(3), axes)
    *_, rows, each = foreseen(*particle, np.ones(1), y, camera, FREE)
    _, log_l = view.update(*particle, rows, each)
    determinants = np.linalg.slogdet(S)[1]
    assert log_l[0] == pytest.approx(-0.5 * (10.0 * math.log1p(nis / 4.0) + determinants), abs=0.01)


@pytest.mark.parametrize("factor", [0.6, 1.0, 1.6])
def test_a_length_that_differs_by_a_factor_moves_the_range_by_that_factor(factor: float) -> None:
    """To either side alike: a line through the lengths would give 1.4 and 0.4 times the range."""
    x, P = np.zeros((1, model.N)), np.zeros((1, model.N, model.N))
    x[0, 0], x[0, model.LOG_SIZE], P[0, 0, 0] = 20.0, math.log(2.0), 20.0**2
    y, axes = seen(x[0], 0.0, np.eye(3))
    y[2:4] *= factor
    camera = np.eye(3), np.zeros(3), axes
    *_, rows, each = foreseen(x, P, np.zeros(1), np.ones(1), y[:4].copy(), camera, FREE)
    view.update(x, P, np.zeros(1), rows._replace(R=1e-8 * np.eye(4)), each)
    assert x[0, 0] == pytest.approx(20.0 / factor, rel=0.01)


def test_an_image_that_fits_no_hypothesis_decides_little_between_them() -> None:
    """Of two that it misses by 8 and 10 of their deviations; a Gaussian would prefer the former by e^18."""
    x, P = np.zeros((2, model.N)), np.zeros((2, model.N, model.N))
    x[:, 0], x[:, 1], x[:, model.LOG_SIZE] = 20.0, [0.8, 1.0], math.log(2.0)
    P[:, 1, 1] = 0.1**2
    y, axes = seen(np.where(np.arange(model.N) == 1, 0.0, x[0]), 0.0, np.eye(3))
    camera = np.eye(3), np.zeros(3), axes
    free = np.full(2, model.FREE)
    *_, rows, each = foreseen(x, P, np.zeros(2), np.full(2, 0.5), y[:4].copy(), camera, free)
    _, log_l = view.update(x, P, np.zeros(2), rows._replace(R=1e-6 * np.eye(4)), each)
    assert 0.5 < log_l[0] - log_l[1] < 4.0


def plain(x: Array, P: Array, J: Array, e: Array) -> tuple[Array, Array, Array]:
    """Mean and covariance after an innovation by a Kalman filter that considers the size, and the innovation's
    covariance."""
    S = J @ P @ J.T + NOISE
    gain = P @ J.T @ np.linalg.inv(S)
    gain[model.LOG_SIZE :] = 0.0
    left = np.eye(model.N) - gain @ J
    return x + gain @ e, left @ P @ left.T + gain @ NOISE @ gain.T, S


def shown(x: Array, heading: float, R_cn: Array, axes: Array) -> Array:
    """The measurement (6,) of a state about given axes."""
    force = x[model.ACCELERATION] + np.append(x[model.TILT], 0.0)
    half = (
        0.5 * math.exp(x[model.WING_SCALE_ERROR] + x[model.LOG_SIZE]) * wing(force, heading, x[model.BANK_ERROR])
    )
    at = []
    for k in (0.0, -1.0, 1.0):
        p = R_cn @ (x[model.POSITION] + k * half)
        at.append(2.0 * axes[1:] @ p / (np.linalg.norm(p) + axes[0] @ p))
    center, left, right = at
    return np.concatenate([center, right - left, 0.5 * (right + left)])


@pytest.mark.parametrize("seed", range(5))
def test_a_short_step_is_that_of_plain_kinematics_seed_0_to_4(seed: int) -> None:
    x, P, heading, _ = drawn(seed)
    moved, dt = np.array([0.3, -0.2, 0.1]), 1e-3
    after, covariance, headings = x[None].copy(), P[None].copy(), np.array([heading])
    step = model.Interval(dt, moved, QUIET, AT_REST, np.ones(3))
    fly_on(after, covariance, headings, np.zeros(1), ALIKE, np.full(1, 0.2), step, FREE)
    assert after[0, model.POSITION] == pytest.approx(
        x[model.POSITION] + dt * x[model.VELOCITY] + 0.5 * dt**2 * x[model.ACCELERATION] - moved, abs=1e-9
    )
    assert after[0, model.VELOCITY] == pytest.approx(x[model.VELOCITY] + dt * x[model.ACCELERATION], abs=1e-9)
    assert after[0, model.TILT] == pytest.approx(x[model.TILT] + 0.2 * dt * x[6:8], abs=1e-9)
    F = np.eye(model.N)
    F[model.POSITION, model.VELOCITY] = F[model.VELOCITY, model.ACCELERATION] = dt * np.eye(3)
    F[model.TILT, 6:8] = 0.2 * dt * np.eye(2)
    assert covariance[0] == pytest.approx(F @ P @ F.T, abs=3e-5)


@pytest.mark.parametrize("accelerates", [0, 1])
@pytest.mark.parametrize("seed", range(3))
def test_a_step_adds_noise_by_range_and_by_what_is_seen_seed_0_to_2(seed: int, accelerates: int) -> None:
    x, P, heading, _ = drawn(seed)
    rng = np.random.default_rng(seed)
    shapes = model.N, (3, model.N), model.N
    noise = model.Noise._make((*(rng.uniform(0.0, 0.1, shape) for shape in shapes), 0.02, 0.4))
    intensities = rng.normal(size=(1, 3))
    both = np.tile(x, (2, 1)), np.tile(P, (2, 1, 1)), np.full(2, heading)
    for k, added in enumerate((QUIET, noise)):
        mean, covariance, headings = (array[k : k + 1] for array in both)
        step = model.Interval(1e-9, np.zeros(3), added, AT_REST, np.ones(3))
        regimes = np.full(1, float(accelerates))
        fly_on(mean, covariance, headings, regimes, intensities, np.full(1, 0.2), step, FREE)
    along = (math.cos(heading) * x[1] - math.sin(heading) * x[0]) / np.linalg.norm(x[model.POSITION])
    seen_of_it = 1.0 - along**2 + assumptions.MIN_VISIBLE_FRACTION**2
    factors = np.exp(2.0 * intensities[0])
    bold = np.ones(model.N)
    bold[: model.BANK_ERROR], bold[model.BANK_ERROR] = factors[0], factors[1]
    larger = math.exp(x[model.LOG_SIZE] - noise.usual)
    broad = bold * seen_of_it * larger**2 * noise.broad[accelerates]
    expected = noise.fixed + broad + (x[model.POSITION] @ x[model.POSITION]) * noise.range_
    # the square of its length in the image is s^2 + tan^2 b, of which the heading turns the first part
    thrust = x[model.ACCELERATION][:2] + x[model.TILT]
    steep = (math.cos(heading) * thrust[1] - math.sin(heading) * thrust[0]) / (model.G - x[model.ACCELERATION][2])
    shortens = (1.0 - seen_of_it) * seen_of_it / (seen_of_it + steep**2) ** 2
    expected[model.WING_SCALE_ERROR] += factors[2] * noise.wobble * shortens
    assert both[1][1] - both[1][0] == pytest.approx(np.diag(expected), rel=1e-9, abs=1e-9)


def test_a_fast_leader_turns_its_nose_with_its_course_and_a_slow_one_does_not() -> None:
    for speed, turned in ((12.0, 0.1), (0.5, 0.0)):
        x = np.zeros((1, model.N))
        x[0, :3], x[0, 3], x[0, 7] = [30.0, 0.0, 0.0], speed, 0.1 * speed  # 0.1 rad/s
        headings = np.zeros(1)
        for _ in range(10):
            P = np.eye(model.N)[None].copy()
            fly_on(x, P, headings, np.zeros(1), ALIKE, np.zeros(1), STEP, FREE)
        assert headings[0] == pytest.approx(turned, abs=0.01)


def test_a_leader_that_hovers_comes_to_rest_over_ground_and_stays_uncertain_by_as_much_as_it_may_move() -> None:
    """Whatever it flew before: the velocity ends at the variance of its Gauss-Markov process."""
    x, P, headings = np.zeros((1, model.N)), np.eye(model.N)[None].copy(), np.zeros(1)
    x[0, :3], x[0, 3:6], x[0, 6:9] = [30.0, 0.0, 0.0], [3.0, -2.0, 1.0], [1.0, 0.5, 0.2]
    decay = math.exp(-0.1 / 1.5)
    hover = model.Hover(decay, 0.1, 0.04 * (1.0 - decay**2), 1e-9)
    for _ in range(300):
        step = STEP._replace(hover=hover)
        fly_on(x, P, headings, np.full(1, float(model.HOVERING)), ALIKE, np.zeros(1), step, FREE)
    assert x[0, model.VELOCITY] == pytest.approx(np.zeros(3), abs=1e-6)
    assert np.diag(P[0])[model.VELOCITY] == pytest.approx(
        0.04 * np.array([1.0, 1.0, assumptions.HOVER_HEIGHT_VARIANCE_RATIO]), rel=0.02
    )
    assert np.linalg.eigvalsh(P[0]).min() > 0.0


@pytest.mark.parametrize("seed", range(3))
def test_what_particles_expect_together_is_the_mixture_of_what_each_expects_seed_0_to_2(seed: int) -> None:
    x, P, heading, R_cn = drawn(seed)
    y, axes = seen(x, heading, R_cn, exchanged=True)
    other, w = x + 0.1 * np.random.default_rng(seed).normal(size=model.N), np.array([0.3, 0.7])
    means, headings, camera = np.array([x, other]), np.array([heading, heading + 0.3]), (R_cn, np.zeros(3), axes)
    free = np.zeros(2)
    mean, S, *_ = foreseen(means, np.array([P, 2.0 * P]), headings, w, y, camera, free)
    exchanged = np.array([1.0, 1.0, -1.0, -1.0, 1.0, 1.0])
    each = [exchanged * shown(m, n, R_cn, axes) for m, n in zip(means, headings, strict=True)]
    assert mean == pytest.approx(w @ each, abs=1e-9)
    expected = np.zeros((6, 6))
    for m, n, h, weight, factor in zip(means, headings, each, w, (1.0, 2.0), strict=True):
        J = np.empty((6, model.N))
        for i, step in enumerate(1e-5 * np.eye(model.N)):
            J[:, i] = exchanged * (shown(m + step, n, R_cn, axes) - shown(m - step, n, R_cn, axes)) / 2e-5
        expected += weight * (factor * J @ P @ J.T + np.outer(h - mean, h - mean))
    assert pytest.approx(expected, rel=2e-3, abs=1e-6) == S


def test_a_wing_seen_along_itself_still_shows_a_tip() -> None:
    found = model.visible(np.array([0.0, 0.5 * math.pi]), np.tile([1.0, 0.0, 0.0], (2, 1)))
    assert found == pytest.approx([1.0, assumptions.MIN_VISIBLE_FRACTION], abs=2e-3)


@pytest.mark.parametrize("seed", range(5))
def test_a_nose_that_is_tied_to_its_course_tells_of_the_course_seed_0_to_4(seed: int) -> None:
    """The update is that of a Kalman filter whose image depends on the velocity by way of the heading."""
    x, P, _, R_cn = drawn(seed)
    x[3:5] += [9.0, 4.0]
    heading = ahead(x)
    predicted, axes = seen(x, heading, R_cn)
    y = predicted + 0.1 * np.random.default_rng(seed).normal(size=6) / F_PX
    J = np.empty((6, model.N))
    for i, step in enumerate(1e-5 * np.eye(model.N)):
        J[:, i] = np.subtract(*(shown(x + k, ahead(x + k), R_cn, axes) for k in (step, -step)))
    J /= 2e-5
    e = y - predicted
    expected, its_covariance, S = plain(x, P, J, e)
    mean, covariance, nis = corrected(x, P, heading, y, axes, R_cn, COURSE_LOCKED)
    assert nis == pytest.approx(e @ np.linalg.solve(S, e), rel=0.02)
    assert mean == pytest.approx(expected, abs=2e-3)
    assert covariance == pytest.approx(its_covariance, abs=2e-3)
    assert np.abs((expected - x)[3:5]).max() > 1e-4


def ahead(x: Array) -> float:
    """Where the course leads half a second later, rad; a slow leader's does not turn."""
    u, v = x[3], x[4]
    return float(math.atan2(v, u) + 0.5 * (u * x[7] - v * x[6]) / (u * u + v * v + 1.0))


@pytest.mark.parametrize("aside", [0.0, 0.08])
def test_a_tied_nose_turns_with_the_course_in_a_step_and_by_an_image(aside: float) -> None:
    x, P, headings = np.zeros((1, model.N)), np.eye(model.N)[None].copy(), np.zeros(1)
    x[0, :3], x[0, 3:5], x[0, 7] = [30.0, 0.0, 0.0], [12.0, 2.0], 1.0
    headings[0] = before = ahead(x[0]) + aside
    fly_on(x, P, headings, np.zeros(1), ALIKE, np.zeros(1), STEP, COURSE_LOCKED)
    assert headings[0] == pytest.approx(ahead(x[0]) + aside)
    assert headings[0] > before + 1e-3
    predicted, axes = seen(x[0], headings[0], np.eye(3))
    off, before = predicted + np.full(6, 1e-2), float(headings[0])
    *_, rows, each = foreseen(x, P, headings, np.ones(1), off, (np.eye(3), np.zeros(3), axes), COURSE_LOCKED)
    view.update(x, P, headings, rows, each)
    assert headings[0] == pytest.approx(ahead(x[0]) + aside)
    assert abs(headings[0] - before) > 1e-3

"""The model of another aircraft, and the filters over it, against Monte Carlo, numerical derivatives and hand."""

import math

import numpy as np
import pytest
from scipy.linalg import expm

from onboard.estimators.traffic.batch import Batch, Radar
from onboard.estimators.traffic.filter import FilterName, choose
from onboard.geometry.rotations import matrix_from_euler, matrix_from_quaternion
from onboard.models import intruder

R_RN = matrix_from_euler(0.1, -0.2, 2.0).T
RADAR = np.array([100.0, -50.0, -30.0])
NOISE = intruder.Noise(
    acceleration=np.array([2.5, 2.5, 1.2]),
    acceleration_time=8.0,
    keeps_turn=False,
    gust=np.array([0.3, 0.3, 0.15]),
    drift=0.2,
    bias_time=60.0,
)
TURNING = intruder.Turning(np.diag([0.01, 0.01, 0.02]), np.ones(3), np.full(3, 10.0))


def stepped(dt: float, noise: intruder.Noise) -> intruder.Step:
    return intruder.with_turning(intruder.step(dt, noise), TURNING)


def beliefs(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    mean = np.concatenate([rng.uniform(-2000, 2000, (count, 3)), rng.normal(0, 20, (count, 12))], axis=1)
    mean[:, 9:] *= np.repeat([0.1, 0.001], 3)
    root = rng.normal(0, 1, (count, 15, 15)) * np.repeat([5.0, 1.0, 0.5, 1.0, 0.01], 3)[:, None]
    return mean, root @ root.transpose(0, 2, 1) + 1e-6 * np.eye(15)


def test_the_transition_is_the_exponential_of_its_rates_and_the_noise_adds_up() -> None:
    A = np.zeros((15, 15))
    A[:3, 3:6] = A[3:6, 6:9] = np.eye(3)
    A[6:9, 6:9], A[9:12, 9:12], A[12:, 12:] = -np.eye(3) / 8.0, -np.eye(3) / 60.0, -np.eye(3) / 10.0
    F, Q = stepped(0.7, NOISE)[:2]
    np.testing.assert_allclose(F, expm(0.7 * A), atol=1e-12)
    one, two = stepped(0.3, NOISE), stepped(0.4, NOISE)
    np.testing.assert_allclose(two.F @ one.F, F, atol=1e-12)
    np.testing.assert_allclose(two.F @ one.Q @ two.F.T + two.Q, Q, atol=1e-9)


def test_acceleration_bias_and_what_is_turned_keep_the_variance_they_are_said_to_have() -> None:
    calm = NOISE._replace(gust=np.zeros(3), drift=0.0)
    F, Q = stepped(0.5, calm)[:2]
    P = np.diag([0.0] * 6 + [2.5**2, 2.5**2, 1.2**2] + [1.0] * 3 + [1e-4, 1e-4, 4e-4])
    after = F @ P @ F.T + Q
    np.testing.assert_allclose(np.diag(after)[6:], np.diag(P)[6:], rtol=1e-9)
    # gusts and our own drift add to velocity and position, by the second
    more = stepped(0.5, NOISE).Q - Q
    np.testing.assert_allclose(np.diag(more)[3:6], 0.5 * NOISE.gust**2)
    np.testing.assert_allclose(np.diag(more)[:3], 0.5 * 0.2**2 + NOISE.gust**2 * 0.5**3 / 3)


def test_reports_do_not_drift_with_our_own_position() -> None:
    """Reports that are off by 1.5 m of their own and by our 1 m, both for a minute: what they say moves only by
    their own, in the model by r_OT_n and what they are off together."""
    noise = NOISE._replace(gust=np.zeros(3), drift=math.sqrt(2.0 / 60.0))
    bias = np.array([[math.hypot(1.5, 1.0)] * 3, [2.0, 3.0, 10.0], [np.inf] * 3, [0.01, 0.5, 1.0]])
    dt = 0.1
    step = intruder.step(dt, noise)
    shared = np.random.default_rng(1).uniform(-0.01, 0.01, (4, 3, 3))
    shared[:3] = 0.0
    Q = intruder.with_reports(step, intruder.Reports(bias, shared), TURNING).Q
    said = np.eye(3, 15)
    said[:, 9:12] = bias[0] * np.eye(3)
    np.testing.assert_allclose(np.diag(said @ Q[0] @ said.T), 2 * dt / 60.0 * 1.5**2, rtol=0.01)
    np.testing.assert_array_equal(Q[2], intruder.with_turning(step, TURNING).Q)  # who says nothing
    assert np.linalg.eigvalsh(Q).min() > -1e-12  # even where reports are said to be better than our own position
    np.testing.assert_array_equal(step.Q[:3, 9:12], 0.0)  # what is kept for other steps is as it was


def test_what_is_turned_and_what_reports_are_off_keep_in_common_what_they_are_said_to() -> None:
    """Where both last equally long. Where not, less, and never more than there is."""
    axes = np.array([[0.01, 0.0, 0.002], [0.0, 0.01, 0.0], [0.0, 0.0, 0.02]])
    shared = np.array([[[0.003, 0.0, -0.002], [0.0, 0.002, 0.001], [0.004, 0.0, 0.008]], np.zeros((3, 3))])
    reports = intruder.Reports(np.array([[4.0, 4.0, 10.0], [np.inf] * 3]), shared)
    for times, share in (([60.0] * 3, 1.0), ([10.0, 20.0, 240.0], None)):
        turning = intruder.Turning(axes, np.array([1.0, 0.5, 1.0]), np.array(times))
        step = intruder.with_reports(intruder.step(5.0, NOISE), reports, turning)
        for k in range(2):
            P = np.zeros((15, 15))
            for _ in range(500):
                P = step.F @ P @ step.F.T + step.Q[k]
            at = np.r_[intruder.BIAS, intruder.TURNED]
            assert np.linalg.eigvalsh(step.Q[k][np.ix_(at, at)]).min() > 0
            np.testing.assert_allclose(
                P[intruder.TURNED, intruder.TURNED], turning.covariance, rtol=1e-6, atol=1e-9
            )
            if share is not None:
                np.testing.assert_allclose(
                    P[intruder.TURNED, intruder.BIAS], share * shared[k], rtol=1e-6, atol=1e-9
                )


def test_more_in_common_than_there_is_leaves_a_covariance_seed_2() -> None:
    rng = np.random.default_rng(2)
    shared = rng.uniform(-1.0, 1.0, (50, 3, 3)) * 10.0 ** rng.uniform(-6, 2, (50, 1, 1))
    bias = 10.0 ** rng.uniform(-2, 3, (50, 3))
    none = TURNING._replace(variances=np.array([0.0, 1.0, 0.3]))
    for noise in (NOISE, NOISE._replace(drift=0.0), NOISE._replace(drift=5.0)):
        for turning in (TURNING, none):
            Q = intruder.with_reports(intruder.step(0.1, noise), intruder.Reports(bias, shared), turning).Q
            scale = np.sqrt(np.maximum(np.diagonal(Q, axis1=1, axis2=2), 1e-18))
            assert np.linalg.eigvalsh(Q / (scale[:, :, None] * scale[:, None, :])).min() > -1e-9


def test_a_track_that_is_often_told_is_as_sure_as_it_may_be_seed_3() -> None:
    """Seen ten times a second to a metre, told five times to half a metre, of an aircraft at rest: 400 runs with
    our own position as it drifts, against the filter's covariance."""
    rng, runs, dt, own, their = np.random.default_rng(3), 400, 0.1, 1.0, 1.5
    drift = own * math.sqrt(2.0 / 60.0)
    noise = NOISE._replace(gust=np.full(3, 1e-3), drift=drift, acceleration=np.full(3, 1e-3))
    bias = np.full((1, 3), math.hypot(own, their))
    step = intruder.with_reports(intruder.step(dt, noise), intruder.Reports(bias, np.zeros((1, 3, 3))), TURNING)
    fade = math.exp(-dt / 60.0)
    walk = math.sqrt(1.0 - fade**2)
    e, b = rng.normal(0, own, runs), rng.normal(0, their, runs)
    start, nees = e.copy(), []
    mean, P = np.zeros((runs, 15)), np.diag([1e-6] * 9 + [1.0] * 3 + [1e-8] * 3)
    for k in range(200):
        e = fade * e + own * walk * rng.normal(0, 1, runs)
        b = fade * b + their * walk * rng.normal(0, 1, runs)
        mean, P = mean @ step.F.T, step.F @ P @ step.F.T + step.Q[0]
        place = e - start  # of the aircraft in our frame, which moves with our own position
        measured = [(1.0, 0.0, place)] + ([(0.5, bias[0, 0], place - e + b)] if k % 2 else [])
        for sigma, scale, y in measured:
            h = np.zeros(15)
            h[0], h[9] = 1.0, scale
            S = h @ P @ h + sigma**2
            K = P @ h / S
            mean = mean + np.outer(y + sigma * rng.normal(0, 1, runs) - mean @ h, K)
            P = P - np.outer(K, K) * S
        if k >= 50 and k % 10 == 0:
            nees.append(np.mean((place - mean[:, 0]) ** 2) / P[0, 0])
    assert 0.9 < np.mean(nees) < 1.1


@pytest.mark.parametrize("rate", [0.1, -0.1])
def test_an_aircraft_that_keeps_its_turn_flies_a_circle(rate: float) -> None:
    speed, dt = 30.0, 0.02
    step = intruder.step(dt, NOISE._replace(keeps_turn=True, acceleration_time=1e9))
    row = np.zeros((1, 15))
    row[0, 3], row[0, 7] = speed, speed * rate
    start, center = row.copy(), np.array([0.0, speed / rate])
    for _ in range(round(2 * math.pi / abs(rate) / dt)):
        row = intruder.moved(row, step)
        assert np.linalg.norm(row[0, :2] - center) == pytest.approx(speed / abs(rate), rel=0.01)
    np.testing.assert_allclose(row[0, :9], start[0, :9], atol=0.3)
    straight = intruder.moved(start, step._replace(keeps_turn=False))
    assert straight[0, 6] == 0.0  # not turned


def test_looking_back_undoes_a_steady_acceleration() -> None:
    rows, _ = beliefs(5, 1)
    lag = np.array([0.0, 0.5, 1.0, -0.2, 3.0])
    then = np.array([intruder.back(dt) @ row[:9] for dt, row in zip(lag, rows, strict=True)])
    np.testing.assert_allclose(intruder.located(rows, lag), then[:, :3], atol=1e-9)
    bias = np.array([[4.0, 4.0, 10.0]] * 4 + [[2.0, 2.0, 2.0]])  # each report by its own kind
    said = intruder.reported(rows, lag, bias)
    np.testing.assert_allclose(said, then[:, :6] + np.pad(bias * rows[:, 9:12], ((0, 0), (0, 3))), atol=1e-9)


def test_how_far_an_aircraft_has_gone_is_from_where_it_was_to_where_it_is() -> None:
    means, covariances = beliefs(6, 4)
    lag = np.array([0.0, 0.1, 0.5, 1.0, 2.0, -0.3])
    far, spread = intruder.gone(means, covariances, lag)
    np.testing.assert_allclose(far, means[:, :3] - intruder.located(means, lag), atol=1e-9)
    for b in range(6):
        moved = (np.eye(9) - intruder.back(lag[b]))[:3]
        np.testing.assert_allclose(spread[b], moved @ covariances[b, :9, :9] @ moved.T, atol=1e-9)


def test_what_a_radar_sees_is_where_it_is() -> None:
    rows, _ = beliefs(50, 2)
    rows[:, 12:] = 0.0
    polar = intruder.seen(rows, np.zeros(50), RADAR, R_RN)
    np.testing.assert_allclose(intruder.position(polar, RADAR, R_RN), rows[:, :3], atol=1e-8)
    ahead = np.zeros((1, 15))
    ahead[0, :3] = 10.0, 10.0, -10.0  # north-east and above, seen from level: right and up
    expected = math.sqrt(300.0), math.pi / 4, math.atan2(10.0, math.hypot(10.0, 10.0))
    np.testing.assert_allclose(intruder.seen(ahead, np.zeros(1), np.zeros(3), np.eye(3))[0], expected)


def test_our_own_attitude_turns_all_that_a_radar_sees_even_overhead() -> None:
    rows, _ = beliefs(50, 2)
    rows[0, :3] = RADAR[0] + 5.0, RADAR[1], RADAR[2] - 1000.0  # nearly straight above: azimuth swings
    w = np.array([2e-3, -1e-3, 3e-3])
    rows[:, 12:] = w
    wrong = intruder.seen(rows, np.zeros(50), RADAR, R_RN)
    half = 0.5 * w
    believed = R_RN @ matrix_from_quaternion(np.array([1.0 - half @ half / 2, *half]))  # our attitude, wrongly
    rows[:, 12:] = 0.0
    expected = intruder.seen(rows, np.zeros(50), RADAR, believed)
    np.testing.assert_allclose(wrong[:, 0], expected[:, 0], rtol=1e-12)
    off = np.remainder(wrong - expected + np.pi, 2 * np.pi) - np.pi
    assert np.abs(off[:, 1:]).max() < 2e-5 * (1 + np.abs(np.tan(expected[:, 2])).max())


def test_what_is_expected_of_a_radar_is_the_models_tangent() -> None:
    means, covariances = beliefs(20, 3)
    polar, spread = intruder.expected(means, covariances, 0.4, RADAR, R_RN)
    lag = np.full(20, 0.4)
    np.testing.assert_allclose(polar, intruder.seen(means, lag, RADAR, R_RN), atol=1e-12)
    H = np.zeros((20, 3, 15))
    for i in range(15):
        h = np.zeros(15)
        h[i] = 1e-3 if i < 12 else 1e-6
        up, down = (intruder.seen(means + s * h, lag, RADAR, R_RN) for s in (1, -1))
        H[:, :, i] = (up - down) / (2 * h[i])
    np.testing.assert_allclose(spread, H @ covariances @ H.transpose(0, 2, 1), rtol=1e-3, atol=1e-7)


def test_the_noise_of_a_place_by_monte_carlo_seed_4() -> None:
    rng, sigma = np.random.default_rng(4), np.array([[8.0, 0.01, 0.012]])
    polar = np.array([[1500.0, 2.0, -0.4]])
    draws = intruder.position(polar + sigma * rng.standard_normal((100_000, 3)), RADAR, R_RN)
    np.testing.assert_allclose(np.cov(draws.T), intruder.position_noise(polar, sigma, R_RN)[0], atol=6.0)


def test_straight_above_the_radar_nothing_is_infinite() -> None:
    means, covariances = beliefs(1, 5)
    means[:] = 0.0
    means[0, 2] = -500.0
    polar, spread = intruder.expected(means, covariances, 0.0, np.zeros(3), np.eye(3))
    assert np.isfinite(polar).all()
    assert np.isfinite(spread).all()
    assert polar[0, 2] == pytest.approx(math.pi / 2, abs=2e-3)


# ------------------------------------------------------------------------------- the filters over it


def test_modes_last_as_long_as_they_are_said_to_and_pass_to_any_other() -> None:
    lasts = np.array([50.0, 15.0, 5.0])
    choice = choose("imm", [NOISE] * 3, lasts.tolist())
    silent = intruder.Reports(np.full((1, 3), np.inf), np.zeros((1, 3, 3)))
    begun = choice.start(np.zeros((1, 15)), np.eye(15)[None])
    np.testing.assert_allclose(begun.probabilities[0], lasts / 70.0)
    np.testing.assert_allclose(choice.predict(begun, 3.0, TURNING, silent).probabilities[0], lasts / 70.0)
    for k, rest in enumerate(np.eye(3)):
        after = choice.predict(begun._replace(probabilities=rest[None]), 0.01, TURNING, silent).probabilities[0]
        left = 0.01 / lasts[k]
        np.testing.assert_allclose(after, np.where(rest, 1.0 - left, left / 2), rtol=2e-3)


@pytest.mark.parametrize("name", ["kf", "ekf", "srukf", "imm"])
def test_what_is_believed_of_some_tracks_is_put_beside_the_others_seed_4(name: FilterName) -> None:
    mean, covariance = beliefs(4, seed=4)
    batch = Batch(choose(name, [NOISE, NOISE._replace(acceleration=np.ones(3))], [50.0, 5.0]))
    for row in range(4):
        batch.add(mean[row], covariance[row])
    before, rows = batch.belief(), np.array([2, 0, 3])
    polar = intruder.seen(mean[rows], np.zeros(3), RADAR, R_RN)
    judged = batch.judge_echoes(rows, 0.0, polar, np.tile([5.0, 0.01, 0.01], (3, 1)), Radar(RADAR, R_RN))
    batch.correct(rows, judged, np.array([2, 0]))
    batch.restart(0, mean[1], covariance[1])
    kept = batch.belief()
    batch._set(batch._state)
    for array, anew in zip(kept, batch.belief(), strict=True):
        np.testing.assert_array_equal(array, anew)
    np.testing.assert_array_equal(kept.mean[1], before.mean[1])
    np.testing.assert_allclose(kept.mean[0], mean[1])
    assert np.trace(kept.covariance[3, :3, :3]) < np.trace(before.covariance[3, :3, :3])

"""The tracker's parts against brute force, numerical derivatives and Monte Carlo."""

import math

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import linear_sum_assignment

from onboard.estimators._traffic_approach import closest, closest_in_turns
from onboard.estimators._traffic_telling import curvature
from onboard.filters.association import assign, candidates
from onboard.geometry.geodesy import geodetic_from_ecef, geodetic_rows
from onboard.geometry.rotations import matrix_from_euler, matrix_from_quaternion
from onboard.models import intruder

R_RN = matrix_from_euler(0.1, -0.2, 2.0).T
RADAR = np.array([100.0, -50.0, -30.0])
NOISE = intruder.Noise(
    acceleration=2.5,
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


# --------------------------------------------------------------------------------------- the model


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
    P = np.diag([0.0] * 6 + [2.5**2] * 3 + [1.0] * 3 + [1e-4, 1e-4, 4e-4])
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
    Q = intruder.with_reports(step, bias).Q
    said = np.eye(3, 15)
    said[:, 9:12] = bias[0] * np.eye(3)
    np.testing.assert_allclose(np.diag(said @ Q[0] @ said.T), 2 * dt / 60.0 * 1.5**2, rtol=0.01)
    np.testing.assert_array_equal(Q[2], step.Q)  # who says nothing
    assert np.linalg.eigvalsh(Q).min() > -1e-12  # even where reports are said to be better than our own position
    np.testing.assert_array_equal(step.Q[:3, 9:12], 0.0)  # what is kept for other steps is as it was


def test_a_track_that_is_often_told_is_as_sure_as_it_may_be_seed_3() -> None:
    """Seen ten times a second to a metre, told five times to half a metre, of an aircraft at rest: 400 runs with
    our own position as it drifts, against the filter's covariance."""
    rng, runs, dt, own, their = np.random.default_rng(3), 400, 0.1, 1.0, 1.5
    drift = own * math.sqrt(2.0 / 60.0)
    noise = NOISE._replace(gust=np.full(3, 1e-3), drift=drift, acceleration=1e-3)
    bias = np.full((1, 3), math.hypot(own, their))
    step = intruder.with_reports(stepped(dt, noise), bias)
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


# ---------------------------------------------------------------------------------- association


def problem(tracks: int, echoes: int, seed: int, size: float) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    root = rng.normal(0, 1, (tracks, 3, 3)) * np.array([5.0, 0.01, 0.01])[:, None]
    spread = root @ root.transpose(0, 2, 1)
    polar = np.column_stack([rng.uniform(500, 500 + size, tracks), rng.uniform(-0.2, 0.2, (tracks, 2))])
    measured = np.column_stack([rng.uniform(500, 500 + size, echoes), rng.uniform(-0.2, 0.2, (echoes, 2))])
    return polar, spread, measured, np.tile([64.0, 1e-4, 1e-4], (echoes, 1))


@pytest.mark.parametrize(("tracks", "echoes", "size"), [(40, 50, 300.0), (1, 200, 50.0), (60, 3, 100.0)])
def test_candidates_are_all_pairs_within_the_gate(tracks: int, echoes: int, size: float) -> None:
    polar, spread, measured, variance = problem(tracks, echoes, 6, size)
    got = {
        (int(i), int(j)): c for i, j, c in zip(*candidates(polar, spread, measured, variance, 16.0), strict=True)
    }
    wanted = {}
    for i in range(tracks):
        for j in range(echoes):
            S, e = spread[i] + np.diag(variance[j]), measured[j] - polar[i]
            d2 = e @ np.linalg.solve(S, e)
            if d2 <= 16.0:
                wanted[i, j] = d2 + np.linalg.slogdet(S)[1]
    assert got.keys() == wanted.keys()
    assert len(wanted) > 3
    for pair, cost in wanted.items():
        assert got[pair] == pytest.approx(cost, rel=1e-9)


def test_azimuths_either_side_of_the_tail_are_near() -> None:
    polar, spread = np.array([[1000.0, math.pi - 0.001, 0.0]]), np.diag([25.0, 1e-5, 1e-5])[None]
    measured, variance = np.array([[1001.0, -math.pi + 0.001, 0.0]]), np.array([[64.0, 1e-4, 1e-4]])
    assert len(candidates(polar, spread, measured, variance, 16.0)[0]) == 1


@pytest.mark.parametrize("seed", range(8))
def test_the_assignment_is_that_of_the_whole_problem(seed: int) -> None:
    """Solved knot by knot it pairs as many, at the same cost, as solved at once."""
    tracks, echoes, costs = candidates(*problem(60, 60, seed, 250.0), 16.0)
    t, e = assign(tracks, echoes, costs)
    assert len(set(t.tolist())) == len(t) == len(set(e.tolist()))
    matrix = np.full((60, 60), 1e9)
    matrix[tracks, echoes] = costs
    row, column = linear_sum_assignment(matrix)
    allowed = matrix[row, column] < 1e9
    assert len(t) == allowed.sum() > 15
    assert matrix[t, e].sum() == pytest.approx(matrix[row, column][allowed].sum())


def test_nothing_to_assign() -> None:
    nothing = np.zeros(0, np.int64)
    assert [len(a) for a in assign(nothing, nothing, np.zeros(0))] == [0, 0]


# --------------------------------------------------------------------------- closest approach


def test_closest_approach_by_hand() -> None:
    r = np.array([[100.0, 30.0, -40.0], [100.0, 0.0, 0.0], [10.0, 20.0, 0.0]])
    v = np.array([[-10.0, 0.0, 0.0], [5.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    a = closest(r, v, np.broadcast_to(np.eye(6), (3, 6, 6)))
    np.testing.assert_allclose(a.time, [10.0, 0.0, 0.0])
    np.testing.assert_allclose(a.distance, [50.0, 100.0, math.hypot(10, 20)])
    np.testing.assert_allclose(a.miss[0], [0.0, 30.0, -40.0])
    assert np.isfinite(a.time_sigma).all()


@pytest.mark.parametrize("miss", [300.0, 60.0])
def test_its_sigmas_by_monte_carlo_seed_7(miss: float) -> None:
    rng = np.random.default_rng(7)
    r, v = np.array([1500.0, miss, 20.0]), np.array([-60.0, 3.0, 1.0])
    P = np.diag([20.0, 15.0, 10.0, 1.0, 0.8, 0.5]) ** 2
    P[0, 3] = P[3, 0] = 8.0
    draws = rng.multivariate_normal(np.concatenate([r, v]), P, 40_000)
    one = closest(r[None], v[None], P[None])
    many = closest(draws[:, :3], draws[:, 3:], np.broadcast_to(P, (40_000, 6, 6)))
    assert one.time_sigma[0] == pytest.approx(many.time.std(), rel=0.05)
    assert one.distance_sigma[0] == pytest.approx(many.distance.std(), rel=0.12)


def test_a_distance_shorter_than_its_own_uncertainty_has_that_of_the_whole_vector() -> None:
    a = closest(
        np.array([[1000.0, 0.0, 0.0]]), np.array([[-50.0, 0.0, 0.0]]), np.diag([9.0] * 3 + [1.0] * 3)[None]
    )
    assert a.distance[0] == pytest.approx(0.0, abs=1e-9)
    assert a.distance_sigma[0] == pytest.approx(math.sqrt(2 * (9.0 + 400.0)), rel=0.01)


def test_the_truth_is_on_a_sphere_and_the_covariance_knows_seed_11() -> None:
    r, sigma = np.array([3000.0, 400.0, -200.0]), 40.0
    u = r / np.linalg.norm(r)
    P = 0.25 * np.outer(u, u) + sigma**2 * (np.eye(3) - np.outer(u, u))
    draws = np.random.default_rng(11).multivariate_normal(np.zeros(3), P, 20_000)
    places = r + draws
    on_it = places / np.linalg.norm(places, axis=1)[:, None] * (np.linalg.norm(r) + draws @ u)[:, None]
    sag = (on_it - r) @ u - draws @ u
    (more,) = curvature(r[None], P[None])
    assert u @ more @ u == pytest.approx(np.mean(sag**2), rel=0.1)
    assert np.trace(more) == pytest.approx(u @ more @ u)  # along the line of sight alone


def along_a_turn(seconds: float = 40.0) -> tuple[float, float]:
    """When and how near the aircraft of the next test comes, step by step."""
    speed, rate, r, v_F = 30.0, 0.08, np.array([700.0, 250.0, -20.0]), np.array([20.0, 0.0, 0.0])
    t = np.arange(0.0, seconds, 1e-3)
    path = -speed / rate * np.column_stack([np.sin(rate * t), 1 - np.cos(rate * t), 0 * t])
    distance = np.linalg.norm(r + path - v_F * t[:, None], axis=1)
    return float(t[distance.argmin()]), float(distance.min())


def turning(sigma: float) -> tuple[np.ndarray, ...]:
    r, v = np.array([[700.0, 250.0, -20.0]]), np.array([[-50.0, 0.0, 0.0]])
    P = np.diag(np.repeat([3.0, 0.4, sigma], 3) ** 2)[None]
    return r, v, np.array([[0.0, -2.4, 0.0]]), P, np.array([20.0, 0.0, 0.0])


def test_the_closest_approach_of_one_that_turns_is_along_its_turn() -> None:
    time, distance = along_a_turn()
    a = closest_in_turns(*turning(0.1))
    assert a.turn_rate[0] == pytest.approx(0.08)
    assert a.time[0] == pytest.approx(time, abs=1e-2)
    assert a.distance[0] == pytest.approx(distance, abs=0.01)
    assert np.linalg.norm(a.miss[0]) == pytest.approx(distance, abs=0.01)
    r, v, _, P, _ = turning(0.1)
    assert closest(r, v, P[:, :6, :6]).distance[0] > distance + 50.0  # straight on


def test_its_sigmas_are_those_of_many_drawn_at_random_seed_9() -> None:
    r, v, a, P, v_F = turning(0.2)
    one = closest_in_turns(r, v, a, P, v_F)
    draws = np.random.default_rng(9).multivariate_normal(np.concatenate([r, v, a], axis=1)[0], P[0], 4000)
    sure = np.broadcast_to(1e-9 * np.eye(9), (4000, 9, 9))
    many = closest_in_turns(draws[:, :3], draws[:, 3:6], draws[:, 6:], sure, v_F)
    assert one.distance_sigma[0] == pytest.approx(many.distance.std(), rel=0.15)
    assert one.time_sigma[0] == pytest.approx(many.time.std(), rel=0.15)


def test_a_turn_that_is_in_doubt_is_none() -> None:
    a = closest_in_turns(*turning(0.9))  # 2.4 m/s^2 is not three sigmas
    assert a.turn_rate[0] == 0.0
    r, v, _, P, _ = turning(0.9)
    assert a.distance[0] == closest(r, v, P[:, :6, :6]).distance[0]


def test_many_places_at_once_are_each_place() -> None:
    rng = np.random.default_rng(8)
    directions = rng.standard_normal((50, 3))
    places = directions / np.linalg.norm(directions, axis=1)[:, None] * rng.uniform(6.35e6, 6.40e6, (50, 1))
    places[:3] = [[0, 0, 6356752.3 + 100], [0, 0, -6356752.3 - 100], [-6378137.0, -1e-9, 0]]
    for place, found in zip(places, geodetic_rows(places), strict=True):
        assert found == pytest.approx(geodetic_from_ecef(place), abs=1e-6)

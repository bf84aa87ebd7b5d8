"""Our own attitude's error, learnt from aircraft that are seen and say where they are: against truth drawn from
the model, and against what must not be believed."""

import numpy as np
import pytest
from msgspec import structs

from onboard.estimators.traffic.batch import Radar
from onboard.estimators.traffic.config import Config
from onboard.estimators.traffic.radar_association import Seeing
from onboard.estimators.traffic.registration import MOST, Registration, Sight
from onboard.estimators.traffic.reports import Report
from onboard.estimators.traffic.table import Table
from onboard.filters.belief import Belief
from onboard.geometry.rotations import matrix_from_quaternion, quaternion_from_vector
from onboard.messages import PeerPosition
from onboard.models import intruder

CONFIG = Config(own_yaw_sigma_deg=0.6, own_tilt_sigma_deg=0.4, report_bias_m=3.0, own_position_sigma_m=1.0)
UNKNOWN = np.radians([0.4, 0.4, 0.6])
RADAR = np.array([5.0, -3.0, 2.0])
NOISE, WHITE = 3.0, 2.0  # m: of the radar, and of each report
SECOND = 1_000_000_000
AHEAD = np.array([[1000.0, 0.3, 0.1]])
SAID = PeerPosition(t_ns=0, t_recv_ns=0, system=1, lat_deg=0.0, lon_deg=0.0, alt_msl=0.0, v_n=(0.0, 0.0, 0.0))


class World:
    """Aircraft at rest around us, each steadily off by what is said, and a rotation drawn from the model; the
    radar scans ten times a second, and each aircraft reports once. With `north` metres all are on one side."""

    def __init__(
        self,
        count: int,
        seed: int,
        own_sigma: float = 1.0,
        north: float = 0.0,
        white: float = WHITE,
        bias: float = 3.0,
    ) -> None:
        self.rng, self.white, self.bias = np.random.default_rng(seed), white, bias
        self.places = self.rng.uniform(-1, 1, (count, 3)) * [3000.0, 3000.0, 400.0]
        if north:
            self.places = north * np.array([1.0, 0.0, 0.0]) + 0.1 * self.places
        self.biases = self.rng.normal(0, bias, (count, 3))
        self.own = self.rng.normal(0, own_sigma, 3)
        self.rotation = self.rng.normal(0, UNKNOWN)
        self.reports = [self.report(k, 0) for k in range(count)]

    def report(self, k: int, t_ns: int) -> Report:
        y = np.concatenate([self.places[k] + self.biases[k] + self.rng.normal(0, self.white, 3), np.zeros(3)])
        R = np.diag([self.white**2] * 3 + [1e-4] * 3)
        return Report(("system", k), t_ns, y, R, np.full(3, self.bias), SAID)

    def scan(self, number: int) -> list[Sight]:
        """Sights of scan `number`, a tenth of a second after the one before."""
        t_ns = number * SECOND // 10
        fade = np.exp(-0.1 / 10.0)
        self.rotation = fade * self.rotation + self.rng.normal(0, UNKNOWN * np.sqrt(1 - fade**2))
        sights = []
        for k, place in enumerate(self.places):
            if number % 10 == k % 10:
                self.reports[k] = self.report(k, t_ns)
            seen = place + np.cross(self.rotation, place - RADAR) + self.own + self.rng.normal(0, NOISE, 3)
            sights.append(Sight(k, seen, self.reports[k].y[:3], NOISE**2 * np.eye(3), self.reports[k]))
        return sights


def watched(world: World, scans: int, config: Config = CONFIG) -> Registration:
    registration = Registration(config)
    for number in range(scans):
        registration.advance(number * SECOND // 10)
        registration.scan(number * SECOND // 10, world.scan(number), RADAR)
    return registration


def covariance_of(registration: Registration) -> np.ndarray:
    return np.asarray(registration._belief.covariance[:3, :3])


def test_the_rotation_is_found_and_as_surely_as_said_seeds_1_to_120() -> None:
    nees, errors = [], []
    for seed in range(1, 121):
        world = World(8, seed)
        registration = watched(world, 31)
        off = world.rotation - registration.rotation
        nees.append(off @ np.linalg.solve(covariance_of(registration), off))
        errors.append(off)
    assert np.sqrt(np.mean(np.square(errors))) < 0.25 * np.mean(UNKNOWN)
    assert 2.25 < np.mean(nees) < 3.75  # 120 times three degrees of freedom, 99.9 %


def test_an_error_of_our_own_position_is_not_taken_for_a_rotation_seeds_1_to_120() -> None:
    config = structs.replace(CONFIG, own_position_sigma_m=8.0)
    nees = []
    for seed in range(1, 121):
        world = World(6, seed, own_sigma=8.0, north=2000.0)
        registration = watched(world, 4, config)
        off = world.rotation - registration.rotation
        nees.append(off @ np.linalg.solve(registration._belief.covariance[:3, :3], off))
    assert 2.25 < np.mean(nees) < 3.75


def test_a_new_report_errs_anew_seeds_1_to_120() -> None:
    """One anchor's reports, each with noise of its own: averaged they would be, were it taken for one."""
    nees = []
    for seed in range(1, 121):
        world = World(1, seed, north=1500.0, white=8.0)
        registration = watched(world, 41)
        off = (world.rotation - registration.rotation)[1:]
        nees.append(off @ np.linalg.solve(registration._belief.covariance[1:3, 1:3], off))
    assert 1.4 < np.mean(nees) < 2.6  # 120 times two, 99.9 %


def test_what_lasts_is_that_of_the_biases_and_our_position_by_hand() -> None:
    """Four anchors 1000 m north, seen and told without noise: the yaw they leave open, by hand."""
    world = World(4, 1)
    world.places = np.tile([1000.0, 0.0, 0.0], (4, 1)) + RADAR
    registration = Registration(CONFIG)
    place, exact = world.places[0], 1e-4 * np.eye(3)
    reports = [Report(r.key, 0, np.r_[place, np.zeros(3)], 1e-4 * np.eye(6), r.bias, SAID) for r in world.reports]
    sights = [Sight(k, place, place, exact, report) for k, report in enumerate(reports)]
    registration.advance(0)
    registration.advance(SECOND)
    registration.scan(SECOND, sights, RADAR)
    theirs = 3.0**2 - 1.0**2  # 3 m against us, of which 1 m is ours
    yaw = 1.0 / (1.0 / UNKNOWN[2] ** 2 + 1000.0**2 / (theirs / 4 + 1.0**2))
    by_them = yaw * (1.0 - yaw / UNKNOWN[2] ** 2)  # not by how the rotation itself moves
    assert registration.residual.covariance[2, 2] == pytest.approx(by_them, rel=1e-3)
    moved = 1.0 - np.exp(-2.0 / CONFIG.own_attitude_time_s)  # what a second changes, about their direction
    assert registration.residual.covariance[0, 0] == pytest.approx(UNKNOWN[0] ** 2 / (1.0 + moved) ** 2, rel=1e-3)
    # about their direction it goes on as fast as our attitude does, elsewhere nearly as slowly as what they err by
    assert np.sort(registration.residual.times)[0] < 1.2 * CONFIG.own_attitude_time_s
    assert np.sort(registration.residual.times)[1] > 0.7 * CONFIG.report_bias_time_s / 2


def test_what_the_rotation_has_in_common_with_reports_is_as_said_seeds_1_to_400() -> None:
    """The first anchor's, off by 3 m of its own and by our 3 m, against errors drawn from the model."""
    off, said, bias = [], [], np.full((2, 3), np.hypot(3.0, 3.0))
    config = structs.replace(CONFIG, own_position_sigma_m=3.0)
    for seed in range(1, 401):
        world = World(3, seed, own_sigma=3.0)
        world.bias = bias[0, 0]
        world.places = np.array([[2000.0, 0.0, 0.0], [2000.0, 100.0, 0.0], [0.0, 2500.0, 0.0]])
        world.reports = [world.report(k, 0) for k in range(3)]
        registration = watched(world, 8, config)
        against = (world.biases[0] - world.own) / bias[0]
        off.append(np.outer(world.rotation - registration.rotation, against))
        shared = registration.shared([7, 0], bias)  # the other is no anchor
        said.append(shared[1])
        np.testing.assert_array_equal(shared[0], 0.0)
    expected = np.mean(said, axis=0)
    assert expected[2, 1] > 3e-4  # two of them, 3 m in 2000
    assert expected[1, 2] < -3e-4
    error = np.std(off, axis=0) / np.sqrt(len(off))
    np.testing.assert_array_less(np.abs(np.mean(off, axis=0) - expected), 3.3 * error)


def test_what_lasts_shrinks_with_more_anchors_and_never_below_our_own_position() -> None:
    sizes = [np.trace(watched(World(count, 7), 6).residual.covariance) for count in (0, 1, 3, MOST)]
    assert sizes[0] == pytest.approx(np.sum(UNKNOWN**2))
    assert sizes == sorted(sizes, reverse=True)
    assert sizes[-1] < 0.02 * sizes[0]
    more = watched(World(3 * MOST, 7), 6)
    assert np.all(np.isfinite(more.rotation))
    assert len(more._anchors) == MOST


def test_one_who_lies_about_his_place_is_not_believed_seed_5() -> None:
    honest, other = World(6, 5), World(6, 5)
    other.places = np.vstack([other.places, [4000.0, 3000.0, -50.0]])
    other.biases = np.vstack([other.biases, [-90.0, 120.0, 0.0]])
    other.reports.append(other.report(6, 0))
    fooled = watched(other, 60)
    assert fooled.residual.covariance == pytest.approx(watched(honest, 60).residual.covariance, rel=0.02, abs=1e-9)
    off = other.rotation - fooled.rotation
    assert off @ np.linalg.solve(covariance_of(fooled), off) < 11.3  # 99 % of three


def test_without_anchors_it_is_forgotten_as_fast_as_it_changes_seed_6() -> None:
    registration = watched(World(6, 6), 31)
    known = registration.rotation.copy()
    for number in range(31, 200):
        registration.advance(number * SECOND // 10)
        assert registration.scan(number * SECOND // 10, [], RADAR) is None
    np.testing.assert_allclose(registration.residual.covariance, np.diag(UNKNOWN**2))
    np.testing.assert_allclose(registration.rotation, known * np.exp(-16.9 / 10.0), rtol=1e-6)
    np.testing.assert_array_equal(registration.jitter(AHEAD, np.eye(3)), 0.0)


def test_scans_average_no_better_than_the_reports_that_they_share_seeds_1_to_60() -> None:
    """The rotation's error is mostly that of reports, ten scans with each. In the mean of two seconds, what tracks
    average, it must be as large as said."""
    config = structs.replace(CONFIG, report_bias_m=0.3, own_position_sigma_m=0.05)
    ratios = []
    for seed in range(1, 61):
        world, registration = World(8, seed, own_sigma=0.05, white=8.0, bias=0.3), Registration(config)
        off, expected = [], []
        for number in range(40):
            registration.advance(number * SECOND // 10)
            registration.scan(number * SECOND // 10, world.scan(number), RADAR)
            if number >= 20:
                off.append(world.rotation - registration.rotation)
                expected.append(registration._jitter)
        spread = registration.residual.covariance + np.mean(expected, axis=0) / len(off)
        mean = np.mean(off, axis=0)
        ratios.append(mean @ np.linalg.solve(spread, mean) / 3.0)
    assert 0.6 < np.mean(ratios) < 1.33  # the upper one at 99.9 % of 60 times three


def test_jitter_is_what_a_rotation_does_to_where_an_echo_comes_from_seed_12() -> None:
    registration, rng = watched(World(6, 12), 31), np.random.default_rng(12)
    R_rn = matrix_from_quaternion(quaternion_from_vector([0.3, -0.2, 1.0]))
    polar = np.array([[1000.0, 0.3, 0.1], [3000.0, -2.0, -0.8], [500.0, 3.0, 0.5]])
    sigma = registration.jitter(polar, R_rn)
    places, seen = intruder.position(polar, np.zeros(3), R_rn), []
    for w in rng.multivariate_normal(np.zeros(3), registration._jitter, 4000):
        rows = np.pad(places + np.cross(w, places), ((0, 0), (0, 12)))
        seen.append(intruder.seen(rows, np.zeros(3), np.zeros(3), R_rn))
    np.testing.assert_allclose(np.std(seen, axis=0)[:, 1:], sigma[:, 1:], rtol=0.05)
    np.testing.assert_array_equal(sigma[:, 0], 0.0)
    assert np.all(np.isfinite(registration.jitter(np.array([[100.0, 0.0, np.pi / 2]]), R_rn)))


def test_a_clock_that_jumps_back_changes_nothing_seed_6() -> None:
    registration = watched(World(6, 6), 11)
    before = registration.rotation.copy()
    registration.advance(0)
    np.testing.assert_array_equal(registration.rotation, before)


def test_the_radar_is_turned_back_by_what_is_known_seed_8() -> None:
    registration = watched(World(8, 8), 11)
    w = registration.rotation
    R_rn = matrix_from_quaternion(quaternion_from_vector([0.3, -0.2, 1.0]))
    d = np.array([1000.0, -500.0, 100.0])
    np.testing.assert_allclose(registration.turned_back(R_rn) @ d, R_rn @ (d + np.cross(w, d)), atol=1.0)


def test_tracks_are_told_at_once_and_then_no_more_seed_9() -> None:
    world, registration = World(8, 9), Registration(CONFIG)
    told = []
    for number in range(50):
        registration.advance(number * SECOND // 10)
        told.append(registration.scan(number * SECOND // 10, world.scan(number), RADAR))
    assert told[0] is not None
    np.testing.assert_array_less(np.abs(told[0].mean), 3.0 * UNKNOWN)
    assert sum(x is not None for x in told[1:]) <= 2


def test_tracks_are_not_told_how_the_rotation_moved_since_the_last_scan_seed_11() -> None:
    """What is told is of the rotation as the tracks know it; its newest step is in no track's place."""
    world, registration = World(8, 11), Registration(CONFIG)
    world.places[0] = [3000.0, 0.0, 0.0]
    world.reports[0] = world.report(0, 0)
    for number in range(20):
        registration.advance(number * SECOND // 10)
        registration.scan(number * SECOND // 10, world.scan(number)[:1], RADAR)
    registration.advance(2 * SECOND)
    before = registration.rotation.copy()
    told = registration.scan(2 * SECOND, world.scan(20), RADAR)
    assert told is not None  # about the first one's direction it has become known
    moved = registration.rotation - before
    assert told.mean[0] == pytest.approx(moved[0], rel=0.2)
    assert abs(told.mean[2]) < 0.9 * abs(moved[2])


# ------------------------------------------------------------------------------------- in the tracks' model


def test_what_turns_keeps_its_covariance_and_each_axis_its_time() -> None:
    axes = matrix_from_quaternion(quaternion_from_vector([0.2, 0.5, -0.1])) @ np.diag([1e-3, 4e-3, 2e-3])
    turning = intruder.Turning(axes, np.array([1.0, 0.3, 0.5]), np.array([10.0, 60.0, 30.0]))
    noise = intruder.Noise(np.full(3, 2.5), 8.0, False, np.full(3, 0.3), 0.2, 60.0)
    step = intruder.with_turning(intruder.step(0.7, noise), turning)
    F, Q = step.F[intruder.TURNED, intruder.TURNED], step.Q[intruder.TURNED, intruder.TURNED]
    np.testing.assert_allclose(F @ turning.covariance @ F.T + Q, turning.covariance, rtol=1e-9, atol=1e-20)
    np.testing.assert_allclose(F @ axes[:, 1], np.exp(-0.7 / 60.0) * axes[:, 1], rtol=1e-12)


def test_what_tracks_are_told_is_what_a_measurement_of_it_would_have_told_seed_10() -> None:
    """Told a posterior of the rotation, a track's other states must be as if it had been measured."""
    rng = np.random.default_rng(10)
    root = rng.normal(0, 1, (2, 15, 15)) * np.repeat([5.0, 1.0, 0.5, 1.0, 0.01], 3)[:, None]
    P, mean = root @ root.transpose(0, 2, 1), rng.normal(0, 1, (2, 15))
    seen, noise = np.array([0.004, -0.002, 0.003]), np.diag([1e-5, 2e-5, 3e-5])
    H = np.zeros((3, 15))
    H[:, intruder.TURNED] = np.eye(3)
    for b in range(2):
        K = P[b] @ H.T @ np.linalg.inv(H @ P[b] @ H.T + noise)
        after, rest = mean[b] + K @ (seen - H @ mean[b]), P[b] - K @ H @ P[b]
        told = Belief(after[intruder.TURNED], rest[intruder.TURNED, intruder.TURNED])
        found = intruder.told_turned(Belief(mean, P), told)
        np.testing.assert_allclose(found.mean[b, :12], after[:12], rtol=1e-6, atol=1e-9)
        np.testing.assert_array_equal(found.mean[b, 12:], 0.0)
        np.testing.assert_allclose(found.covariance[b], rest, rtol=1e-5, atol=1e-9)


def test_each_track_drifts_against_its_own_reports() -> None:
    """What our own position drifts in a second, 1/30 m^2, goes into r_OT_n and out of what reports are off, of the
    track that has heard some."""
    table = Table(Config(own_position_sigma_m=1.0, own_position_time_s=60.0))
    table.advance(SECOND)
    for number in (1, 2):
        table.begin(np.zeros(15), np.eye(15), ("system", number), SECOND, "peer")
    table.tracks[1].report = Report(("system", 2), SECOND, np.zeros(6), np.eye(6), np.array([2.0, 3.0, 4.0]), SAID)
    table.advance(2 * SECOND)
    first, second = table.batch.belief().covariance[:, intruder.R, intruder.BIAS]
    np.testing.assert_allclose(first, 0.0, atol=1e-12)
    np.testing.assert_allclose(second, -np.diag([1 / 60, 1 / 90, 1 / 120]), rtol=1e-6, atol=1e-12)


def test_echoes_are_as_noisy_as_the_radar_and_what_is_not_known_of_our_attitude_seed_13() -> None:
    table = Table(CONFIG)
    table.registration = watched(World(6, 13), 31)
    sigma = np.array([[10.0, 0.002, 0.004]])
    radar, noisy = Seeing(table)._registered(Radar(RADAR, np.eye(3)), AHEAD, sigma)
    jitter = table.registration.jitter(AHEAD, np.eye(3))
    assert np.all(jitter[0, 1:] > 1e-4)
    np.testing.assert_allclose(noisy, np.sqrt(sigma**2 + jitter**2))
    np.testing.assert_array_equal(radar.R_rn, table.registration.turned_back(np.eye(3)))


def test_each_track_has_in_common_with_the_rotation_what_its_own_reports_have() -> None:
    world, table = World(4, 3), Table(CONFIG)
    table.advance(SECOND)
    for number in range(1, 5):
        table.begin(np.zeros(15), np.eye(15), ("system", number), SECOND, "peer")
        table.tracks[-1].report = world.reports[number - 1]
    sights = [s._replace(number=s.number + 1) for s in world.scan(0)[:2]]
    table.registration.advance(SECOND)
    table.registration.scan(SECOND, sights, RADAR)
    table.advance(2 * SECOND)
    common = table.batch.belief().covariance[:, intruder.TURNED, intruder.BIAS]
    assert np.abs(common[:2]).max(axis=(1, 2)).min() > 1e-5
    np.testing.assert_allclose(common[2:], 0.0, atol=1e-15)


def test_vertical_accelerations_are_a_share_of_horizontal_ones() -> None:
    table = Table(Config(filter="ekf", manoeuvre_acceleration_m_s2=2.0, vertical_share=0.25))
    np.testing.assert_allclose(np.diag(table.first_covariance())[intruder.A], [4.0, 4.0, 0.25])
    table.advance(SECOND)
    table.begin(np.zeros(15), np.zeros((15, 15)), None, SECOND, "radar")
    table.advance(2 * SECOND)
    grown = np.diag(table.batch.belief().covariance[0])[intruder.A]
    np.testing.assert_allclose(grown[2], grown[0] * 0.25**2)


def test_velocity_walks_as_far_in_three_seconds_as_gusts_change_it() -> None:
    """Of 0.5 m/s, with a time constant of 5 s: by 2 (1 - exp(-3/5)) 0.25 = 0.2256 m^2/s^2, by hand."""
    table = Table(Config(filter="ekf", gust_m_s=0.5, gust_vertical_m_s=0.25, manoeuvre_acceleration_m_s2=1e-6))
    table.advance(SECOND)
    table.begin(np.zeros(15), np.zeros((15, 15)), None, SECOND, "radar")
    for second in range(2, 5):
        table.advance(second * SECOND)
    grown = np.diag(table.batch.belief().covariance[0])[intruder.V]
    np.testing.assert_allclose(grown, [0.2256, 0.2256, 0.0564], rtol=1e-3)

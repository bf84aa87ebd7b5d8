"""The wing-line model compared with projections and derivatives computed another way."""

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.geometry.rotations import matrix_from_euler, quaternion_from_euler
from onboard.models import leader_flight, relative_motion, wing_line
from onboard.models.leader_flight import A_ALONG, BANK_ERROR, HEADING, ImageGeometry, ModeParameters
from onboard.models.relative_motion import A_LAT, A_LONG, SIZE, FollowerMotion, R, V

G = 9.80665
RIGID = ModeParameters(1e-9, 2.0, 1e9, 1.0, 60.0)


def row(n: int = leader_flight.BASE, **values: float) -> Array:
    x = np.zeros(n)
    x[R], x[V], x[SIZE] = (20.0, 3.0, -1.0), (1.0, 2.0, -0.5), 2.6
    x[A_LAT], x[A_LONG], x[HEADING] = 2.4, 0.3, np.arctan2(4.0, 16.0)
    for name, value in values.items():
        x[leader_flight.COMPONENTS.index(name)] = value
    return x


def geometry(
    R_cn: Array, axes: Array, v_F_n: tuple[float, ...] = (15.0, 2.0, 0.0), omega: Array | None = None
) -> ImageGeometry:
    return ImageGeometry(
        R_cn[None],
        np.array([[0.3, -0.1, 0.2]]),
        np.array([v_F_n]),
        np.zeros((1, 3)) if omega is None else omega[None],
        axes[None],
    )


def wing_of(x: Array, v_F_n: Array, eps: float) -> Array:
    """The wing's direction (3,) in n."""
    return np.array(leader_flight.wing_axis(x, *(x[V] + v_F_n), eps))


def image_of(x: Array, wing_n: Array, R_cn: Array, r_FC_n: Array) -> Array:
    """Image points (3, 2) of a wing, by hand."""
    points = [R_cn @ (x[R] + k * 0.5 * x[SIZE] * wing_n - r_FC_n) for k in (0, -1, 1)]
    return np.array([[p[1] / p[0], p[2] / p[0]] for p in points])


def test_without_the_new_states_it_moves_as_oh_and_johnsons_model() -> None:
    x = row()
    v0, a = np.array([15.0, 2.0, 0.1]), np.array([0.2, -0.4, 0.1])
    motion = FollowerMotion(v0, v0 + 0.02 * a, a, a)
    expected = relative_motion.process(x[None, :9], 0.02, motion, 0.0)[0]
    ours = leader_flight.process(x[None], 0.02, v0[None], a[None], RIGID)[0]
    np.testing.assert_allclose(ours[:9], expected, rtol=0, atol=1e-9)


def test_acceleration_along_the_track_changes_the_speed_by_itself_times_the_time() -> None:
    x = row(a_lat=0.0, a_long=0.0, a_along=1.5)
    v_F, still = np.array([[15.0, 2.0, 0.0]]), np.zeros((1, 3))
    after = leader_flight.process(x[None], 0.01, v_F, still, RIGID._replace(along_time=1e9))[0]
    speeds = [np.linalg.norm(s[V] + v_F[0]) for s in (x, after)]
    assert speeds[1] - speeds[0] == pytest.approx(0.015, rel=1e-6)


def test_a_hovering_leader_accelerates_where_its_nose_points_and_nothing_is_nan() -> None:
    x = np.zeros(leader_flight.BASE)
    x[SIZE], x[A_ALONG], x[HEADING] = 1.0, 2.0, np.radians(90.0)
    still = np.zeros((1, 3))
    after = leader_flight.process(x[None], 0.01, still, still, ModeParameters(1.0, 1e9, 3.0, 1.0, 60.0))[0]
    np.testing.assert_allclose(after[V], [0.0, 0.02, 0.0], atol=1e-6)
    assert np.isfinite(leader_flight.process(np.zeros((1, 12)), 0.01, still, still, RIGID)).all()


def test_the_nose_follows_the_course_and_tends_to_it() -> None:
    v_F, still = np.array([[20.0, 0.0, 0.0]]), np.zeros((1, 3))
    x = np.zeros(leader_flight.BASE)
    x[SIZE], x[HEADING] = 2.0, 0.1 + 4 * np.pi  # not wrapped: two turns on
    after = leader_flight.process(x[None], 0.5, v_F, still, ModeParameters(1e-3, 1.0, 2.0, 1.0, 60.0))[0]
    assert after[HEADING] == pytest.approx(4 * np.pi + 0.1 * np.exp(-0.25), abs=1e-9)
    x[HEADING], x[A_LAT] = 0.0, 4.0  # a turn to the right at 4/20 rad/s
    after = leader_flight.process(x[None], 0.1, v_F, still, RIGID)[0]
    assert after[HEADING] == pytest.approx(0.02, rel=1e-3)


def test_a_coordinated_turn_banks_the_wing_by_the_arctangent_of_a_over_g() -> None:
    x = row(a_lat=2.4, a_long=0.0, a_along=0.0)
    x[V] = (1.0, 2.0, 0.0)
    v_F = np.array([15.0, 2.0, 0.0])
    wing = wing_of(x, v_F, 1e-9)
    expected = matrix_from_euler(float(np.arctan(2.4 / G)), 0.0, float(np.arctan2(4.0, 16.0)))[:, 1]
    np.testing.assert_allclose(wing, expected, atol=1e-9)


def test_a_pull_up_lessens_the_bank_that_a_turn_needs() -> None:
    """Lift carries the weight and the pull: 3 m/s^2 up, tan(bank) = a / (g + 3)."""
    x = row(a_lat=2.4, a_long=3.0, a_along=0.0)
    x[V] = (1.0, 2.0, 0.0)
    wing = wing_of(x, np.array([15.0, 2.0, 0.0]), 1e-9)
    assert np.arcsin(wing[2]) == pytest.approx(np.arctan(2.4 / (G + 3.0)), abs=1e-9)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_what_is_predicted_is_what_points_projected_by_hand_measure(seed: int) -> None:
    rng = np.random.default_rng(seed)
    R_cn = matrix_from_euler(*rng.uniform(-0.4, 0.4, 3)).T
    x = row(a_along=0.4, bank_error=rng.uniform(-0.2, 0.2), heading=rng.uniform(-1, 1))
    wing = wing_of(x, np.array([15.0, 2.0, 0.0]), 1.0)
    points = image_of(x, wing, R_cn, np.array([0.3, -0.1, 0.2]))
    for m in (wing_line.M, wing_line.M_MIDDLE):
        y, _, axes = wing_line.from_points(points[None], np.full((1, 3), 1e-3), m)
        predicted = leader_flight.measure(x[None], geometry(R_cn, axes[0]), 1.0, m)[0]
        np.testing.assert_allclose(predicted, y[0], atol=1e-12)
    np.testing.assert_allclose(axes[0] @ axes[0].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes[0]) == pytest.approx(1.0)


def test_near_the_axis_the_measurement_is_in_radians_right_and_down() -> None:
    points = np.array([[[0.0, 0.0], [-0.02, 0.01], [0.03, -0.01]]])
    y, R_y, axes = wing_line.from_points(points, np.array([[1e-3, 2e-3, 3e-3]]))
    np.testing.assert_allclose(axes[0], np.eye(3), atol=1e-15)
    np.testing.assert_allclose(y[0], [0, 0, 0.05, -0.02], atol=2e-5)
    np.testing.assert_allclose(np.diag(R_y[0]), [1e-6, 1e-6, 13e-6, 13e-6], rtol=5e-3)


@pytest.mark.parametrize("seed", [4, 5])
def test_the_noise_is_that_of_the_points_by_differences(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.6, 0.6, 2) + rng.uniform(-0.2, 0.2, (3, 2))
    sigmas = rng.uniform(1e-3, 3e-3, 3)
    _, R_y, axes = wing_line.from_points(points[None], sigmas[None], wing_line.M_MIDDLE)

    def coordinates(p: Array) -> Array:
        d = np.column_stack([np.ones(3), p])
        d /= np.linalg.norm(d, axis=1)[:, None]
        s = 2 * d @ axes[0, 1:].T / (1 + d @ axes[0, 0])[:, None]
        return np.concatenate([s[0], s[2] - s[1], 0.5 * (s[1] + s[2])])

    J = np.zeros((6, 6))
    for i in range(6):
        step = np.zeros(6)
        step[i] = 1e-6
        J[:, i] = (coordinates(points + step.reshape(3, 2)) - coordinates(points - step.reshape(3, 2))) / 2e-6
    expected = J @ np.diag(np.repeat(sigmas, 2) ** 2) @ J.T
    np.testing.assert_allclose(R_y[0], expected, rtol=1e-5, atol=1e-14)
    _, without, _ = wing_line.from_points(points[None], sigmas[None])
    np.testing.assert_array_equal(without[0], R_y[0, :4, :4])


def test_a_leader_behind_the_camera_is_not_folded_to_the_front() -> None:
    ahead, behind = row(), row()
    behind[R] = -ahead[R]
    axes = np.eye(3)
    predicted = leader_flight.measure(np.array([ahead, behind]), geometry(np.eye(3), axes), 1.0, wing_line.M)
    assert np.hypot(*predicted[0, :2]) < 0.5
    assert np.hypot(*predicted[1, :2]) > 4.0


def test_a_delay_shows_where_the_leader_was_and_how_the_camera_stood() -> None:
    """The image of t - tau, stamped t: camera turning at omega, leader moving relative to us."""
    tau, omega = 0.05, np.array([0.05, -0.1, 0.2])  # rad/s, in c
    x = row(leader_flight.N_DELAY, a_lat=0.0, a_long=0.0)
    x[leader_flight.BASE] = tau
    R_cn = matrix_from_euler(0.1, -0.05, 0.3).T
    w, vx, vy, vz = quaternion_from_euler(0.0, 0.0, 0.0)
    assert (w, vx, vy, vz) == (1.0, 0.0, 0.0, 0.0)
    angle = np.linalg.norm(omega) * tau
    k = omega / np.linalg.norm(omega)
    K = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    R_then = (np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K) @ R_cn
    then = x.copy()
    then[R] -= tau * x[V]
    then[leader_flight.BASE] = 0.0
    axes = np.eye(3)
    expected = leader_flight.measure(then[None], geometry(R_then, axes), 1.0, wing_line.M)[0]
    ours = leader_flight.measure(x[None], geometry(R_cn, axes, omega=omega), 1.0, wing_line.M)[0]
    undelayed = leader_flight.measure((x * (np.arange(13) != 12))[None], geometry(R_cn, axes), 1.0, wing_line.M)[0]
    np.testing.assert_allclose(ours, expected, atol=1e-4)
    assert np.abs(undelayed - expected).max() > 3e-3


def test_a_bias_is_the_rotation_from_the_cameras_assumed_attitude_to_its_true_one() -> None:
    bias = np.array([0.01, -0.02, 0.015])
    x = row(leader_flight.N_BIAS)
    x[-3:] = bias
    R_cn = matrix_from_euler(0.1, -0.05, 0.3).T
    B = np.array([[0, -bias[2], bias[1]], [bias[2], 0, -bias[0]], [-bias[1], bias[0], 0]])
    expected = leader_flight.measure(x[None, :12], geometry((np.eye(3) - B) @ R_cn, np.eye(3)), 1.0, 6)
    ours = leader_flight.measure(x[None], geometry(R_cn, np.eye(3)), 1.0, 6)
    np.testing.assert_allclose(ours, expected, atol=1e-12)
    assert x[BANK_ERROR] == 0.0


def test_a_leader_that_hovers_loses_its_own_velocity_and_turns_its_nose_at_a_rate() -> None:
    """Its own velocity, not that relative to a follower that speeds up meanwhile."""
    x, v_F, a_F = row(a_lat=0.5, a_long=-0.2), np.array([[3.0, 1.0, 0.0]]), np.array([[0.4, -0.2, 0.1]])
    parameters = RIGID._replace(eps=1.0)  # its nose follows no course at a walking pace
    x[V] = (0.5, -0.2, 0.1) - v_F[0]
    on = leader_flight.process(x[None], 0.1, v_F, a_F, parameters)[0]
    still = leader_flight.process(x[None], 0.1, v_F, a_F, parameters._replace(hover_time=0.5, nose_rate=0.3))[0]
    own = [after[V] + v_F[0] + 0.1 * a_F[0] for after in (on, still)]
    np.testing.assert_allclose(own[1], np.exp(-0.1 / 0.5) * own[0], rtol=1e-12)
    np.testing.assert_allclose(still[[A_LAT, A_LONG]], np.exp(-0.1 / 0.5) * x[[A_LAT, A_LONG]], rtol=1e-12)
    assert still[HEADING] - on[HEADING] == pytest.approx(0.03)


def test_the_middle_of_a_wing_turned_aside_is_seen_beside_its_center_by_hand() -> None:
    """The nearer half looks longer, by s^2 sin cos / (r^2 - (s sin)^2): s half the wing, r its distance."""
    s, r, turned = 1.3, 25.0, np.radians(60.0)
    x = row(heading=turned, a_lat=0.0, a_long=0.0)
    x[R], x[V], x[SIZE] = (r, 0.0, 0.0), 0.0, 2 * s
    here = geometry(np.eye(3), np.eye(3), (0.0, 0.0, 0.0))._replace(r_FC_n=np.zeros((1, 3)))
    predicted = leader_flight.measure(x[None], here, 1.0, wing_line.M_MIDDLE)[0]
    # the right wingtip of a nose to the right is the nearer one
    beside = s * s * np.sin(turned) * np.cos(turned) / (r * r - (s * np.sin(turned)) ** 2)
    assert predicted[4] - predicted[0] == pytest.approx(beside, rel=2e-2)
    assert predicted[2] == pytest.approx(2 * s * np.cos(turned) / r, rel=1e-2)

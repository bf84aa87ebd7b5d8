"""What a wing's slope says of a tilt, and a tilt of a heading."""

import math

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.estimators.leader import assumptions
from onboard.estimators.leader.assumptions import LeaderModel
from onboard.estimators.leader.hypotheses import motion as model
from onboard.estimators.leader.hypotheses import tilt
from onboard.estimators.leader.hypotheses.motion import ACCELERATION, BANK_ERROR, POSITION, TILT, VELOCITY, G

MODEL = LeaderModel(
    size=2.0, size_sigma=0.04, misalignment=(0.0, 0.0, 0.0), misalignment_time=60.0, own_velocity=0.1
)
WIND = 3.0  # m/s


def drawn(seed: int) -> tuple[Array, Array, float, float]:
    """A leader, its covariance, and two headings that show a wing."""
    rng = np.random.default_rng(seed)
    x = np.zeros(model.N)
    x[POSITION], x[VELOCITY] = [25.0, *rng.uniform(-5.0, 5.0, 2)], rng.uniform(-8.0, 8.0, 3)
    x[ACCELERATION], x[TILT], x[BANK_ERROR] = *rng.normal(0.0, 0.5, (1, 3)), rng.normal(0.0, 1.5, 2), 0.05
    root = rng.normal(0.0, 0.3, (model.N, model.N))
    one, other = math.atan2(x[1], x[0]) + rng.uniform(-1.1, 1.1, 2)
    return x, root @ root.T, one, other


def in_image(heading: float, x: Array) -> tuple[float, float]:
    """Right and down of the wing from tip to tip, per length, by the vectors themselves."""
    ahead = x[POSITION] / np.linalg.norm(x[POSITION])
    right = np.cross([0.0, 0.0, 1.0], ahead)
    right /= np.linalg.norm(right)
    level = np.array([-math.sin(heading), math.cos(heading), 0.0])
    across = (x[ACCELERATION] + [*x[TILT], 0.0]) @ level
    bank = math.atan2(across, G - x[8]) + x[BANK_ERROR]
    wing = math.cos(bank) * level + np.array([0.0, 0.0, math.sin(bank)])
    return float(wing @ right), float(wing @ np.cross(ahead, right))


@pytest.mark.parametrize("seed", range(5))
def test_the_slope_is_that_of_the_wing_in_space_seed_0_to_4(seed: int) -> None:
    x, _, heading, _ = drawn(seed)
    right, down = in_image(heading, x)
    assert tilt.slope_of(heading, x) == pytest.approx(down / right)
    assert tilt.banked(down / right, heading, x)[1] == pytest.approx(math.hypot(right, down))


@pytest.mark.parametrize("aspect_deg", [86.0, 89.6, 90.3, 92.0])
def test_a_wing_that_points_at_us_from_above_shows_its_length_and_no_bank(aspect_deg: float) -> None:
    """From 52 degrees below, it stands nearly upright in the image: what tells headings apart is how nearly."""
    x, heading = np.zeros(model.N), math.radians(aspect_deg)
    x[POSITION], x[BANK_ERROR] = [14.0, 0.0, -18.0], math.radians(2.0)
    right, down = in_image(heading, x)
    assert tilt.slope_of(heading, x) == pytest.approx(down / right)
    bank, length = tilt.banked(down / right, heading, x)
    assert bank == pytest.approx(math.radians(2.0))
    assert length == pytest.approx(math.hypot(right, down))


@pytest.mark.parametrize("seed", range(5))
def test_with_another_nose_it_leans_so_that_the_wing_slopes_as_before_seed_0_to_4(seed: int) -> None:
    x, P, heading, other = drawn(seed)
    right, down = in_image(heading, x)
    tilt.retilt(down / right, heading, other, x, P, 0.2, WIND)
    after = in_image(other, x)
    assert after[1] / after[0] == pytest.approx(down / right)
    along = np.array([math.cos(other), math.sin(other)])
    assert along @ x[TILT] == pytest.approx(0.2 * along @ x[3:5])  # no image shows it: as its drag lets it
    assert np.linalg.eigvalsh(P).min() > 0.0


def test_a_lean_is_likely_that_drag_times_airspeed_gives_and_others_are_not() -> None:
    """Of a leader that flies north at 8 m/s with its heading to the east: it tilts across its heading."""
    x, P = np.zeros(model.N), 1e-6 * np.eye(model.N)
    x[0], x[3] = 25.0, 8.0
    of_lean = {}
    for lean in (1.6, 0.0, -1.6):
        x[10] = lean
        of_lean[lean] = tilt.likely(0.5 * math.pi, x, P, 0.2, WIND, 0.0)
    variance = (0.2 * WIND) ** 2 + assumptions.TILT_VARIANCE
    steady = 0.5 * 1.6**2 / assumptions.STEADY_TILT_VARIANCE
    assert of_lean[1.6] - of_lean[0.0] == pytest.approx(0.5 * 1.6**2 / variance - steady, abs=1e-4)
    assert of_lean[0.0] - of_lean[-1.6] == pytest.approx(0.5 * (3.2**2 - 1.6**2) / variance + steady, abs=1e-4)


def test_drags_have_the_mean_and_the_deviation_of_the_model() -> None:
    drags = tilt.drags_of(MODEL, 3, 200_000)
    assert drags.mean() == pytest.approx(MODEL.drag, rel=0.02)
    assert drags.std() == pytest.approx(MODEL.drag_sigma, rel=0.05)
    assert drags.min() > 0.0
    assert not tilt.drags_of(MODEL._replace(drag=0.0), 3, 5).any()  # a fixed wing tilts on no air


def test_the_slope_of_a_first_image_is_shared_by_lean_turn_and_bank_at_its_full_cost() -> None:
    """A slope of 0.3, seen broadside from the same height: a bank of 16.7 degrees."""
    means, P = np.zeros((1, model.N)), np.zeros((1, model.N, model.N))
    means[0, 0] = 25.0
    P[0, TILT, TILT] = 1.0 * np.eye(2)
    P[0, 6:8, 6:8] = 2.0 * np.eye(2)
    bank = 1.0 / G  # as uncertain as the tilt
    log_l = tilt.first(means, P, np.zeros(1), np.full(1, 0.3), 0.3, WIND, np.full(1, bank))
    assert means[0, 11] == pytest.approx(0.25 * 0.3 * G)
    assert means[0, 7] == pytest.approx(0.5 * 0.3 * G)
    assert means[0, BANK_ERROR] == pytest.approx(0.25 * 0.3)
    variance = (0.3 * WIND) ** 2 + assumptions.TILT_VARIANCE + 2.0 + 1.0
    cost = (0.3 * G) ** 2 * (1.0 / variance + 1.0 / assumptions.STEADY_TILT_VARIANCE)
    assert log_l[0] == pytest.approx(-0.5 * (cost + math.log(variance)))


def test_the_density_of_a_slope_is_one_whatever_share_of_the_wing_is_seen() -> None:
    """Over all slopes each heading is as likely: without its Jacobian one that shows a fifth were so five
    times."""
    headings, slopes = np.arccos(np.array([0.9, 0.5, 0.2])), np.linspace(-40.0, 40.0, 8001)
    total = np.zeros(3)
    for slope in slopes:
        means, P = np.zeros((3, model.N)), np.tile(np.eye(model.N), (3, 1, 1))
        means[:, 0] = 25.0
        total += np.exp(tilt.first(means, P, headings, np.full(3, 0.16), slope, 3.0, np.full(3, 0.1)))
    assert total / total[0] == pytest.approx(np.ones(3), rel=0.02)

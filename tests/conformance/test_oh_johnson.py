"""What the paper's text pins down, number by number, and the misprint of eq 14."""

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.estimators.oh_johnson import noise as flown
from onboard.filters import unscented
from onboard.models import camera_angles, relative_motion
from onboard.models.relative_motion import SIZE
from simlink.scenarios.scenario import load_scenario
from studies.relative_motion.flights import fly_many
from studies.relative_motion.formation import M_PER_FT, Method, Setting, track
from studies.relative_motion.methods import PAPER_MENDED, TUNED
from studies.relative_motion.noise import PAPER
from studies.relative_motion.scores import truth_of

MEASURE = camera_angles.measure
SCENARIO = load_scenario("formation")


def test_weights_are_eqs_23_to_25() -> None:
    weights = unscented.julier_weights(9)
    assert weights.spread == pytest.approx(3**0.5, abs=0)
    assert weights.mean == pytest.approx(-2.0, rel=1e-15)  # 1 - n / gamma^2
    assert weights.other == pytest.approx(1 / 6, rel=1e-15)
    assert weights.mean + 18 * weights.other == pytest.approx(1.0, rel=1e-15)
    assert weights.mean == weights.covariance


def test_paper_settings_are_eqs_51_to_54() -> None:
    foot = 0.3048
    expected = [5, 5, 5, 10, 10, 10, 0.01 * 8.75, 2, 2]
    Q = flown.process_noise(8.75 * foot, PAPER.walks)
    assert np.sqrt(np.diag(Q)) / foot == pytest.approx(expected, rel=1e-12)
    assert np.array_equal(flown.process_noise(8.75 * foot), Q)
    first = flown.first_belief(np.array([0.1, -0.05, 0.08]), 8.75 * foot, 0.2 * foot, np.eye(3), np.zeros(3))
    sigmas = [1, 1, 1, 1, 1, 1, 0.2, 10, 10]
    assert np.sqrt(np.diag(first.covariance)) / foot == pytest.approx(sigmas, rel=1e-12)
    assert np.degrees(np.sqrt(np.diag(flown.ANGLES))) == pytest.approx([5.0, 4.0, 3.0], rel=1e-12)
    assert not PAPER.ties_size_to_range
    assert PAPER.angles_deg == (5.0, 4.0, 3.0)
    assert PAPER.gate_probability is None
    assert not PAPER.consider_size


def as_printed(points: Array, R_cn: Array, r_FC_n: Array) -> Array:
    """Eq 14 with x_3, the down component of the position, in its third row, where the size x_7 belongs."""
    misread = points.copy()
    misread[:, SIZE] = points[:, 2]
    angles = MEASURE(points, R_cn, r_FC_n)
    angles[:, 2] = MEASURE(misread, R_cn, r_FC_n)[:, 2]
    return angles


def test_eq_14_as_printed_contradicts_eq_13() -> None:
    """A leader 10 m ahead, level with the camera, 2 m in size: it does not subtend an angle of zero."""
    row = np.zeros((1, 9))
    row[0, 0], row[0, SIZE] = 10.0, 2.0
    assert as_printed(row, np.eye(3), np.zeros(3))[0, 2] == 0.0
    mended = MEASURE(row, np.eye(3), np.zeros(3))[0, 2]
    assert np.tan(mended / 2) == pytest.approx(2.0 / (2 * 10.0), rel=1e-15)


@pytest.mark.parametrize("method", [PAPER_MENDED, TUNED], ids=["paper", "tuned"])
def test_eq_14_as_printed_loses_the_leader_seed_5(monkeypatch: pytest.MonkeyPatch, method: Method) -> None:
    flights = fly_many(SCENARIO, [5], duration=10.0)
    truth = truth_of(flights.one(0))[-1, relative_motion.POSITION]

    def error() -> float:
        last = track(flights, Setting(SCENARIO.camera), method).mean[0, -1, relative_motion.POSITION]
        return float(np.linalg.norm(last - truth))

    mended = error()
    monkeypatch.setattr(
        camera_angles,
        "measure_batch",
        lambda points, R_cn, r_FC_n: np.array(
            [as_printed(*one) for one in zip(points, R_cn, r_FC_n, strict=True)]
        ),
    )
    lost = error()
    assert mended < 8 * M_PER_FT
    assert not lost < 30 * M_PER_FT, (mended, lost)  # NaN counts as lost

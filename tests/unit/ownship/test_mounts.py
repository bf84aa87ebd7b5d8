"""A mount that is wrong is named with its degrees, and a right one never."""

import re
from typing import Any

import numpy as np
import pytest

from onboard.config import parse_config
from onboard.geometry.rotations import matrix_from_euler
from onboard.health.mounts import FEWEST_WINDOWS, Sight, _why, equations, errors
from onboard.health.remedies import remedy_of
from onboard.messages import DOUBT, Advice, Datagram
from onboard.pipeline import Pipeline
from onboard.units import NS_PER_S
from simlink.scenarios.scenario import Scenario, load_scenario
from simlink.simulation import datagrams
from tests.support.streams import S

CAMERA = parse_config({}).camera_model()
UP_DEG = 8.0  # as the camera of the scenario `guided` looks
LEADER = {"size_prior_m": 2.667, "leader_class": "multirotor"}


def windows(wrong: Any, seed: int, count: int = 20, nod: float = 0.1, focal: float = 1.0) -> tuple[Any, ...]:
    """Windows of a vehicle that leans and turns behind a leader with a path of its own, seen by a camera that is
    turned by `wrong` (3,) rad against what is configured, and whose focal length is `focal` times as long.
    1.5 mrad of noise."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        phases, rates, a = rng.uniform(0, 6, 3), rng.uniform(2, 5, 3), rng.normal(size=(3, 3))
        sights = []
        for k in range(50):
            t = 0.04 * k
            R = matrix_from_euler(*(nod * np.sin(rates * t + phases)))
            r_F = 0.5 * a[0] * t**2 + 0.2 * a[1] * np.sin(3 * t)
            r_L = np.array([30.0, 2.0, -4.0]) + a[2] * t**2
            d = r_L - r_F
            u = (R @ matrix_from_euler(*wrong)).T @ d
            u = u * (1.0, focal, focal)
            u = u / np.linalg.norm(u) + 0.0015 * rng.normal(size=3)
            sights.append(Sight(int(t * S), R, u / np.linalg.norm(u), r_F, float(np.linalg.norm(d))))
        found.append(equations(sights))
    return tuple(found)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("degrees", [-15.0, 15.0, 30.0])
def test_a_wrong_mount_is_measured_within_its_sigma_seed_1(axis: int, degrees: float) -> None:
    wrong = np.zeros(3)
    wrong[axis] = np.radians(degrees)
    found = errors(windows(wrong, 1))
    assert found is not None
    theta, sigma = np.degrees(found[0][:3]), np.degrees(found[1][:3])
    assert theta[axis] == pytest.approx(degrees, abs=max(5 * sigma[axis], 0.2 * abs(degrees)))
    assert sigma.max() < 1.5
    assert "`mount_rpy_deg`" in _why(CAMERA, *found).words


@pytest.mark.parametrize("focal", [0.5, 0.7, 1.4, 2.0])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_wrong_focal_length_is_measured_within_its_sigma_seeds_1_and_2(focal: float, seed: int) -> None:
    """With half of it everything is twice as near, and all estimates were valid without a word."""
    found = errors(windows(np.zeros(3), seed, focal=focal))
    assert found is not None
    theta, sigma = found
    assert theta[3] == pytest.approx(focal - 1.0, abs=max(5 * sigma[3], 0.2 * abs(focal - 1.0)))
    assert np.abs(theta[:3]).max() < np.radians(5.0)
    why = _why(CAMERA, *found)
    measured = re.search(r"`f_px` were (\S+) times as long", why.words)
    assert measured is not None
    assert float(measured[1]) == pytest.approx(focal, rel=0.2)
    assert remedy_of(why.cause).advice == "focal"


def test_a_right_camera_is_never_doubted_seeds_1_to_20() -> None:
    assert [seed for seed in range(1, 21) if errors(windows(np.zeros(3), seed)) is not None] == []


def test_a_wrong_camera_without_lean_is_not_claimed_seeds_1_to_20() -> None:
    """Nothing shows it: neither an error nor a guess."""
    wrong = np.radians([0.0, 15.0, 0.0])
    assert all(errors(windows(wrong, seed, nod=0.0, focal=2.0)) is None for seed in range(1, 21))
    assert errors(windows(wrong, 1, count=FEWEST_WINDOWS - 1)) is None


def hints(scenario: Scenario, mount_deg: list[float], seconds: float, seed: int) -> list[str]:
    table = {"camera": {"mount_rpy_deg": mount_deg}, "estimator": {"leader": LEADER}}
    pipeline, t_ns = Pipeline(parse_config(table)), 0
    for item in datagrams(scenario, seed, seconds):
        if isinstance(item, Datagram):
            pipeline.feed(item)
            t_ns = item.t_recv_ns
    return [r.reason for r in pipeline.health(t_ns).refusals if r.reason.startswith(DOUBT)]


@pytest.mark.slow
@pytest.mark.parametrize(("pitch", "words"), [(15.0, "lower"), (-30.0, "higher"), (0.0, "")])
def test_a_flight_with_a_circle_shows_its_mount_seed_3(pitch: float, words: str) -> None:
    found = hints(load_scenario("guided"), [0.0, UP_DEG + pitch, 0.0], 120.0, 3)
    measured = [re.search(rf"looked (\d+) degrees {words} ", reason) for reason in found]
    assert [m is not None and float(m[1]) == pytest.approx(abs(pitch), rel=0.2) for m in measured] == [
        True
    ] * bool(words)


@pytest.mark.slow
def test_the_status_advises_a_mount_that_is_20_degrees_off_seed_5() -> None:
    """A health every second, as the daemon has it and `onboard status` shows it."""
    table = {"camera": {"mount_rpy_deg": [0.0, UP_DEG - 20.0, 0.0]}, "estimator": {"leader": LEADER}}
    pipeline, due, found = Pipeline(parse_config(table)), 0, list[Advice]()
    for item in datagrams(load_scenario("guided"), 5, 100.0):
        if isinstance(item, Datagram):
            pipeline.feed(item)
            if item.t_recv_ns >= due:
                due = item.t_recv_ns + NS_PER_S
                found += [advice for advice in pipeline.health(item.t_recv_ns).advice if advice.kind == "mount"]
    assert found, "no advice in 100 s"
    measured = re.search(r"looked (\d+) degrees higher", found[-1].what)
    assert measured is not None
    assert float(measured[1]) == pytest.approx(20.0, rel=0.2)
    assert "mount_rpy_deg" in found[-1].what + found[-1].remedy


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 3])
def test_a_noisy_attitude_makes_no_mount_wrong_seeds_1_3(seed: int) -> None:
    assert hints(load_scenario("mission"), [0.0, 8.0, 0.0], 60.0, seed) == []

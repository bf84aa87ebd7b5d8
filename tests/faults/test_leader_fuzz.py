"""Any sequence of images, whatever their times and points: no exception, nothing out that is not finite."""

import math
import os

import numpy as np
import pytest

from onboard.estimators import leader
from onboard.geometry.camera import make_camera
from onboard.geometry.rotations import Array
from onboard.messages import TargetPoints
from onboard.ownship import Ownship
from tests.streams import MS, Flight, S, make_config

SEQUENCES = int(os.environ.get("FUZZ_SEQUENCES", "400"))  # raise it for a long run
LENGTH = 12
EXTREMES = (0.0, 1e-300, 1e-9, 0.3, 0.57, 1.0, 99.0, 1e6, 1e300, -1e300, math.nan, math.inf, -math.inf)
FILTERS = ("wing-line", "wing-line delay", "subtended", "paper")


def sound(estimate_mean: tuple[float, ...] | None, covariance: tuple[tuple[float, ...], ...] | None) -> bool:
    if estimate_mean is None or covariance is None:
        return estimate_mean is None and covariance is None
    P = np.array(covariance)
    finite = bool(np.isfinite(estimate_mean).all() and np.isfinite(P).all())
    return finite and bool((np.diag(P) > 0).all()) and np.array_equal(P, P.T)


def any_image(rng: np.random.Generator, t_ns: int, flight: Flight) -> TargetPoints:
    """A right image, a wrong one, or an impossible one."""
    kind = rng.integers(0, 4)
    points: Array = flight.points(t_ns / S) + rng.normal(size=(3, 2)) / 554.0
    if kind == 1:
        points = rng.uniform(-0.6, 0.6, (3, 2))
    elif kind == 2:
        points = rng.choice(np.array(EXTREMES), (3, 2)) * rng.choice([-1.0, 1.0], (3, 2))
    sigma = (
        None
        if rng.random() < 0.7
        else (float(rng.choice(EXTREMES)), float(rng.choice(EXTREMES)), abs(float(rng.normal(0, 1e-3))))
    )
    center, left, right = (tuple(p) for p in points.tolist())
    target = str(rng.choice(["leader", "leader", "target/1", ""]))
    return TargetPoints(
        t_ns=t_ns, t_recv_ns=t_ns, camera="fuzz", target=target, center=center, left=left, right=right, sigma=sigma
    )


@pytest.mark.parametrize("name", FILTERS)
def test_no_sequence_of_images_breaks_a_track_seed_7(name: str) -> None:
    kind, *more = name.split()
    settings = [f"estimator.leader.filter={kind}", "estimator.leader.initialise_images=1"]
    if more:
        settings.append("estimator.leader.delay_sigma_s=0.1")
    config = make_config(*settings).estimator["leader"]
    camera = make_camera(f_px=554.256, width_px=640, height_px=480)
    rng = np.random.default_rng(7)
    for _ in range(SEQUENCES):
        one, ownship = leader.Estimator(config, camera), Ownship(max_extrapolation=0.1)
        flight = Flight(
            radius=float(rng.choice([40.0, 200.0])),
            speed=float(rng.uniform(0.1, 30.0)),
            gap=float(rng.uniform(3, 60)),
        )
        t_ns = 5 * S
        for _ in range(LENGTH):
            t_ns += int(rng.choice([0, 1, 20, 40, 100, 500, 3000, 12000])) * MS
            if rng.random() < 0.8:
                for message in (flight.attitude(t_ns), flight.position(t_ns)):
                    ownship.receive(message, t_ns)
                told = one.tick(ownship)
                assert all(sound(e.mean, e.covariance) for e in told)
            when = t_ns + int(rng.choice([-2000, -300, -60, -20, 0, 0, 0, 30, 5000])) * MS
            told = one.observe(any_image(rng, when, flight), ownship)
            assert all(sound(e.mean, e.covariance) for e in told)

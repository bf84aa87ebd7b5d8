"""The wind says where a fixed wing's heading points: reports of it, and what the leader's tracks make of them."""

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.arrays import Array
from onboard.estimators.leader import assumptions
from onboard.estimators.leader.assumptions import GUST_SIGMA_M_S, WIND_SIGMA_M_S
from onboard.estimators.leader.hypotheses.summary import HEADING
from onboard.estimators.leader.hypotheses.wind import wind_of
from onboard.geometry.rotations import matrix_from_euler
from onboard.messages import Clock, Estimate, Message, Wind
from onboard.models.relative_motion import POSITION, VELOCITY
from tests.support.mavlink_frames import frame, one
from tests.support.streams import EPOCH, Flight, Run, S, Stream, advance, encode, make_config

CRAB: Final = math.radians(20.0)
SPEED: Final = 15.0
FIXED_WING: Final = "estimator.leader.leader_class=fixed_wing"


@dataclass(frozen=True)
class Crabbing(Flight):
    """Both fly north, the leader's heading to the right of its course: the wind blows to the left."""

    radius: float | None = None

    def points(self, t: float) -> Array:
        """As those of `Flight`, the wing turned."""
        follower, leader = self.at(t), self.at(t, self.gap)
        wing = matrix_from_euler(0.0, 0.0, CRAB)[:, 1] * self.size / 2
        r_c = np.array([leader.r + offset - follower.r for offset in (0 * wing, -wing, wing)])
        return np.asarray(r_c[:, 1:] / r_c[:, :1])


def report(t: float, east: float = -SPEED * math.tan(CRAB), sigma: float | None = 0.5) -> Wind:
    ns = round(t * S)
    return Wind(t_ns=ns, t_recv_ns=EPOCH + ns, clock=Clock.NONE, north=0.0, east=east, sigma=sigma)


def winds(begin: float, end: float) -> Iterator[Message]:
    yield from (report(t) for t in np.arange(begin + 0.001, end, 1.0))


def flown(t1: float, *reports: Message, settings: tuple[str, ...] = (FIXED_WING,), t0: float = 5.0) -> Run:
    messages = [item.message for item in Stream(flight=Crabbing(), t0=t0, t1=t1, sparse=True).items()]
    return advance(sorted([*messages, *reports], key=lambda m: m.t_recv_ns), make_config(*settings))


def along(estimate: Estimate) -> tuple[float, float]:
    """Error of the range and its standard deviation, both over the true range."""
    assert estimate.valid
    r, P = np.array(estimate.mean)[POSITION], np.array(estimate.covariance)[POSITION, POSITION]
    distance = float(np.linalg.norm(Crabbing().relative(estimate.t_ns / S)[0]))
    return float(np.linalg.norm(r)) / distance - 1.0, math.sqrt(float(r @ P @ r / (r @ r))) / distance


def test_wind_of_both_autopilots_from_packed_bytes() -> None:
    """ArduPilot's says where it comes from; PX4's states the sum of two variances, others an accuracy."""
    ardupilot = one(frame(168, 1, struct.pack("<3f", 90.0, 5.0, 0.3)))
    assert (ardupilot.north, ardupilot.east, ardupilot.sigma) == (pytest.approx(0.0, abs=1e-6), -5.0, None)
    fields = [0.0, 0.0, 500.0, 0.0, 0.0]
    px4 = one(frame(231, 105, struct.pack("<Q8f", 7, 3.0, -4.0, 0.0, 0.5, *fields[1:])))
    assert (px4.north, px4.east, px4.sigma) == (3.0, -4.0, 0.5)
    accurate = one(frame(231, 105, struct.pack("<Q8f", 7, 3.0, -4.0, 0.0, 0.5, 0.0, 0.0, 1.25, 0.0)))
    assert accurate.sigma == 1.25


def test_wind_survives_the_wire() -> None:
    sent = report(1.0)
    datagram = encode([(sent.t_recv_ns, sent)])[0]  # type: ignore[list-item]
    read = one(datagram.data)
    assert (read.north, read.east) == (0.0, pytest.approx(sent.east))
    assert read.sigma == pytest.approx(0.5)


def test_what_a_report_says_of_the_wind_about_the_leader() -> None:
    stated, silent = wind_of(report(0.0, sigma=0.75)), wind_of(report(0.0, sigma=None))
    assert stated is not None
    assert silent is not None
    assert stated.sigma == math.hypot(0.75, GUST_SIGMA_M_S)
    assert silent.sigma == math.hypot(WIND_SIGMA_M_S, GUST_SIGMA_M_S)
    assert stated.velocity.tolist() == [0.0, -SPEED * math.tan(CRAB), 0.0]


def test_an_autopilot_that_estimates_no_wind_reports_none_and_not_calm() -> None:
    """An ArduCopter sends 0.0 in every message, whatever blows."""
    copter = one(frame(168, 1, struct.pack("<3f", 0.0, 0.0, 0.0)))
    assert wind_of(copter) is None
    calm = wind_of(replace(report(0.0, sigma=0.5), north=0.0, east=0.0))
    assert calm is not None
    assert calm.sigma == math.hypot(0.5, GUST_SIGMA_M_S)


def heading(estimate: Estimate) -> tuple[float, float]:
    """The heading and its standard deviation, degrees; a wing looks the same from the front and from behind."""
    assert estimate.mean is not None
    variance = np.array(estimate.covariance)[HEADING, HEADING]
    return math.degrees(math.remainder(estimate.mean[HEADING], math.pi)), math.degrees(math.sqrt(variance))


def test_a_crab_is_told_from_another_range_by_the_wind_seed_1() -> None:
    """Seen from behind, 20 degrees shorten the wing by 6 %."""
    runs = flown(26.0), flown(26.0, *winds(5.0, 26.0))
    off, right = (np.mean([along(e)[0] for e in run.estimates if e.t_ns > 18 * S]) for run in runs)
    assert 0.02 < off < 0.075
    assert abs(right) < 0.02
    without, within = (run.estimates[-1] for run in runs)
    assert within.reason == "images fused"
    assert heading(within)[0] == pytest.approx(20.0, abs=2.0)
    assert abs(heading(without)[0]) < heading(without)[1]
    assert heading(within)[1] < 7.0  # the wind's error over the airspeed
    assert heading(without)[1] > 10.0  # any wind
    assert within.mean is not None
    assert np.linalg.norm(within.mean[VELOCITY]) < 0.3  # relative to us, whatever the air does


def test_wind_is_forgotten_when_its_reports_end_seed_1(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(assumptions, "WIND_TIMEOUT_NS", 6 * S)
    run = flown(22.0, *winds(5.0, 8.0))
    before = [heading(e)[0] for e in run.estimates if e.valid and 12.0 < e.t_ns / S < 13.0]
    assert min(before) > 15.0
    assert abs(heading(run.estimates[-1])[0]) < 8.0


@pytest.mark.parametrize("east", [math.nan, math.inf, 61.0])
def test_a_wind_that_cannot_be_is_counted_and_changes_nothing_seed_1(east: float) -> None:
    run, without = flown(7.0, report(6.001, east)), flown(7.0)
    assert run.pipeline.health(0).verdicts["leader.wind_implausible"] == 1
    assert run.estimates[-1].mean == without.estimates[-1].mean

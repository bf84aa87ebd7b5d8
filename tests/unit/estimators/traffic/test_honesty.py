"""The tracks' covariances are as large as their errors: neither over- nor underconfident, over many aircraft whose
reports are off as the configuration says. And what a report or an approach is worth, by its sigma."""

import math
from collections.abc import Iterator
from copy import deepcopy
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.arrays import Array
from onboard.autopilot.traffic import TrafficOutput
from onboard.config import TrafficOutConfig
from onboard.estimators.traffic.config import Config
from onboard.estimators.traffic.motion import gust_random_walk
from onboard.filters.gating import chi_square_threshold
from onboard.messages import ClosestApproach, Collision, MeasurementReport, ThreatLevel, Verdict
from tests.support.honesty import assert_honest, assert_neither_too_sure_nor_too_unsure, nees
from tests.support.traffic import EAST, NAME, NORTH, R0, V0, Sky, fly_with_reports, mean
from tests.support.vehicle_records import INTRUDER, TRAFFIC

AIRCRAFT = 40
SECONDS = 12
LATENCY_SIGMA_S = 0.02
STEP_S = 0.05


class Path(NamedTuple):
    """An aircraft's address, and its places (k, 3) and velocities (k, 3), a row each STEP_S."""

    icao: int
    r: Array
    v: Array

    def at(self, t: float) -> tuple[Array, Array]:
        """Place and velocity at a time, s."""
        k, beyond = int(t / STEP_S), t - STEP_S * int(t / STEP_S)
        return self.r[k] + beyond * self.v[k], self.v[k]


def paths(seed: int, *, manoeuvres: bool) -> Iterator[Path]:
    """Aircraft all around, kilometres apart: each on a straight line, or its accelerations and gusts drawn as the
    single filters expect them."""
    rng, config = np.random.default_rng(seed), Config()
    level = np.array([1.0, 1.0, config.vertical_share])
    sigma = level * config.manoeuvre_acceleration_m_s2 * manoeuvres
    kept = math.exp(-STEP_S / config.manoeuvre_time_s)
    gust = gust_random_walk(
        np.array([config.gust_m_s, config.gust_m_s, config.gust_vertical_m_s]), config.gust_time_s
    )
    for k in range(AIRCRAFT):
        angle = 2 * math.pi * k / AIRCRAFT
        place = 8000.0 * np.array([math.cos(angle), math.sin(angle), 0.0]) + [0.0, 0.0, -200.0]
        course = rng.uniform(0, 2 * math.pi)
        a, r = sigma * rng.normal(size=3), [place]
        v = [40.0 * np.array([math.cos(course), math.sin(course), 0.0])]
        for _ in range(round((SECONDS + 2.0) / STEP_S)):
            r.append(r[-1] + STEP_S * v[-1] + 0.5 * STEP_S**2 * a)
            v.append(v[-1] + STEP_S * a + gust * manoeuvres * math.sqrt(STEP_S) * rng.normal(size=3))
            a = kept * a + sigma * math.sqrt(1.0 - kept**2) * rng.normal(size=3)
        yield Path(0x100000 + k, np.array(r), np.array(v))


@cache
def errors(filter_: str, seed: int, *, manoeuvres: bool = False) -> list[tuple[Array, Array]]:
    """Error (6,) and covariance (6, 6) of each aircraft at the end. Each report is off by white noise and by its
    age, each aircraft by a steady error."""
    rng, config = np.random.default_rng(1000 + seed), Config()
    sky = Sky(filter=filter_, adsb_latency_sigma_s=LATENCY_SIGMA_S)
    flown = list(paths(seed, manoeuvres=manoeuvres))
    white = np.array([config.adsb_position_sigma_m, config.adsb_position_sigma_m, config.adsb_altitude_sigma_m])
    steady = np.array([config.report_bias_m, config.report_bias_m, config.report_bias_altitude_m])
    bias = steady * rng.normal(size=(AIRCRAFT, 3))
    for _ in range(SECONDS):
        for k, path in enumerate(flown):
            old = LATENCY_SIGMA_S * rng.normal()
            r, v = path.at(sky.t)
            place = r - old * v + bias[k] + white * rng.normal(size=3)
            sky.receive(sky.adsb(place, v + config.adsb_velocity_sigma_m_s * rng.normal(size=3), icao=path.icao))
        sky.fly(1.0)
    found = []
    for path in flown:
        estimate = sky.newest[f"icao/{path.icao:06x}"]
        assert estimate.valid
        found.append(
            (mean(estimate) - np.concatenate(path.at(estimate.t_ns * 1e-9)), np.array(estimate.covariance))
        )
    return found


@pytest.mark.parametrize("filter_", ["imm", "ekf"])
def test_nees_of_the_position_seeds_1_and_2(filter_: str) -> None:
    assert_honest([nees(error[:3], P[:3, :3]) for error, P in errors(filter_, 1) + errors(filter_, 2)], 3)


def test_nees_of_position_and_velocity_of_aircraft_that_fly_as_expected_seeds_1_and_2() -> None:
    """By the extended filter, whose one model is what is drawn."""
    found = errors("ekf", 1, manoeuvres=True) + errors("ekf", 2, manoeuvres=True)
    assert_honest([nees(error[3:], P[3:, 3:]) for error, P in found], 3)
    assert_honest([nees(error, P) for error, P in found], 6)


@pytest.mark.parametrize("filter_", ["imm", "ekf"])
def test_the_velocity_is_neither_too_sure_nor_too_unsure_seed_1(filter_: str) -> None:
    """On straight lines it is pessimistic, by the manoeuvres that it has to expect."""
    mean_nees = np.mean([nees(error[3:], P[3:, 3:]) for error, P in errors(filter_, 1)])
    assert_neither_too_sure_nor_too_unsure(float(mean_nees), 3)


@cache
def heard_for(seconds: int) -> Sky:
    sky = Sky()
    fly_with_reports(sky, seconds)
    return sky


def judged(off: Array) -> MeasurementReport:
    """What becomes of a report that is off by that much."""
    sky = deepcopy(heard_for(8))
    sky.receive(sky.adsb(R0 + V0 * sky.t + off, V0))
    sky.fly(0.1)
    measurement = sky.newest[NAME].measurement
    assert measurement is not None
    return measurement


@pytest.mark.parametrize("direction", [NORTH, EAST])
def test_the_gate_of_reports_is_that_of_six_numbers_and_its_probability(direction: Array) -> None:
    """The farther off, the less it fits: the last that is fused is just inside, the next just outside."""
    gate = chi_square_threshold(0.999, 6)
    found = [judged(off * direction) for off in range(10, 26)]
    first = [m.verdict for m in found].index(Verdict.GATED)
    assert {m.verdict for m in found[:first]} == {Verdict.FUSED}
    assert {m.verdict for m in found[first:]} == {Verdict.GATED}
    inside, outside = found[first - 1].nis, found[first].nis
    assert inside is not None
    assert outside is not None
    assert 0.8 * gate < inside <= gate < outside < 1.2 * gate
    assert all(m.gate == pytest.approx(gate) for m in found)


def passing(miss: float, seconds: int, down: float = -60.0) -> ClosestApproach:
    """Of an aircraft ahead that will pass `miss` metres east of us and 60 m higher, after so many reports."""
    sky = Sky()
    fly_with_reports(sky, seconds, np.array([1500.0, miss, down]), np.array([-30.0, 0.0, 0.0]))
    intruder = sky.newest[NAME].intruder
    assert intruder is not None
    return intruder.approach


def test_a_threat_is_low_while_it_may_be_nearer_than_the_limit_by_two_sigmas() -> None:
    """At 209 m: with 32 m of sigma it may be within 150 m, with 25 m it may not."""
    unsure, sure = passing(200.0, 5), passing(200.0, 8)
    assert unsure.distance == pytest.approx(sure.distance) == pytest.approx(math.hypot(200, 60), abs=1.0)
    assert unsure.distance - 2.0 * unsure.distance_sigma < 150.0 < sure.distance - 2.0 * sure.distance_sigma
    assert unsure.distance - unsure.distance_sigma > 150.0
    assert (unsure.threat, sure.threat) == (ThreatLevel.LOW, ThreatLevel.NONE)
    assert passing(100.0, 8).threat is ThreatLevel.HIGH


@pytest.mark.parametrize("down", [-60.0, 60.0])
def test_what_passes_above_us_has_a_positive_vertical_distance_in_the_record_and_in_collision(down: float) -> None:
    approach = passing(100.0, 5, down)
    assert approach.vertical == pytest.approx(-down, abs=0.5)
    assert approach.horizontal == pytest.approx(100.0, abs=0.5)
    estimate = replace(TRAFFIC, intruder=replace(INTRUDER, approach=approach))
    ((name, message),) = TrafficOutput(TrafficOutConfig(link="gcs"), 191)._messages(estimate, estimate.intruder)
    assert name == "COLLISION"
    assert isinstance(message, Collision)
    assert message.vertical == pytest.approx(-down, abs=0.5)

"""No simulator flies at a default of an estimator: what it draws lies around it, or apart from it."""

import math
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest

from onboard.config import CameraConfig, OwnErrors
from onboard.config.cameras import mount_errors
from onboard.estimators.leader.assumptions import LeaderModel
from onboard.estimators.leader.config import Config as Leader
from onboard.estimators.own_state.config import AIRFRAMES
from onboard.estimators.own_state.config import Config as OwnState
from onboard.estimators.traffic.config import Config as Traffic
from simlink.encounters.conditions import GIMBAL_TILT_ERROR_DEG, GIMBAL_YAW_ERROR_DEG, draw_conditions
from simlink.scenarios.scenario import Scenario, load_scenario
from simlink.world.drawn import draw_scenario

SEEDS = range(1, 61)
ROOT12 = math.sqrt(12.0)
LEADER, OWN, TRAFFIC = Leader(), OwnState(), Traffic()
HEADINGS = LeaderModel(2.0, 0.04, (0.01, 0.01, 0.01), 60.0, 0.1)


class Pair(NamedTuple):
    """A default, and what a run of a scenario has in its place. `is_around`: it is drawn on both sides."""

    name: str
    default: float
    simulated: Callable[[Scenario], float]
    is_around: bool = True


def motor_time(scenario: Scenario) -> float:
    return scenario.quadrotor.motor_time if scenario.quadrotor else 0.0


def pressure_drift(scenario: Scenario) -> float:
    """As a random walk, m per square root of a second."""
    drift = scenario.barometer.drift
    return drift.sigma * math.sqrt(2.0 / drift.time)


FORMATION = (
    Pair("own_tilt_sigma_deg", LEADER.own_tilt_sigma_deg, lambda s: s.nav.attitude_deg.sigma),
    Pair("own_yaw_sigma_deg", LEADER.own_yaw_sigma_deg, lambda s: s.nav.yaw_deg.sigma if s.nav.yaw_deg else 0.0),
    Pair("own_attitude_time_s", LEADER.own_attitude_time_s, lambda s: s.nav.attitude_deg.time),
    Pair("own_velocity_sigma_m_s", LEADER.own_velocity_sigma_m_s, lambda s: s.nav.velocity.sigma),
    Pair("tilt_sigma_deg", OwnErrors().tilt_sigma_deg, lambda s: s.nav.attitude_deg.sigma),
    Pair("sigma_px", CameraConfig().sigma_px, lambda s: s.camera.sigma_px),
    Pair("nose_wobble", math.degrees(HEADINGS.nose_wobble), lambda s: s.leader.heading_wobble_deg.sigma),
    Pair("stretch_time", HEADINGS.stretch_time, lambda s: s.leader.heading_wobble_deg.time),
    Pair("bank", math.degrees(HEADINGS.bank), lambda s: s.leader.bank_wobble_deg.sigma, False),
    Pair("bank_time", HEADINGS.bank_time, lambda s: s.leader.bank_wobble_deg.time),
)
QUADROTOR = (
    Pair("attitude_sigma_deg", OWN.attitude_sigma_deg[0], lambda s: math.degrees(s.nav.attitude_white[0])),
    Pair("attitude_sigma_deg, yaw", OWN.attitude_sigma_deg[2], lambda s: math.degrees(s.nav.attitude_white[2])),
    Pair("rates_sigma_deg_s", OWN.rates_sigma_deg_s, lambda s: math.degrees(s.nav.rates_white)),
    Pair("gps_velocity_sigma_m_s", OWN.gps_velocity_sigma_m_s[0], lambda s: s.gps.velocity_white),
    Pair("gps_velocity_sigma_m_s, z", OWN.gps_velocity_sigma_m_s[2], lambda s: s.gps.vertical_velocity_white),
    Pair(
        "motor_time_s", AIRFRAMES["csvsf"].motor_time_s, lambda s: s.quadrotor.motor_time if s.quadrotor else 0.0
    ),
    Pair("pressure_sigma_m", OWN.pressure_sigma_m, lambda s: s.barometer.white, False),
    Pair(
        "pressure_drift",
        OWN.pressure_drift,
        lambda s: s.barometer.drift.sigma * math.sqrt(2 / s.barometer.drift.time),
    ),
    Pair("bias_sigma_m_s2", OWN.bias_sigma_m_s2, lambda s: s.imu.accel_bias, False),
)
TRAFFIC_SCENE = (
    Pair("adsb_latency_s", TRAFFIC.adsb_latency_s, lambda s: sum(s.traffic.adsb.latency) / 2),
    Pair(
        "adsb_latency_sigma_s",
        TRAFFIC.adsb_latency_sigma_s,
        lambda s: (s.traffic.adsb.latency[1] - s.traffic.adsb.latency[0]) / ROOT12,
    ),
    Pair("peer_latency_s", TRAFFIC.peer_latency_s, lambda s: sum(s.traffic.peer.latency) / 2),
    Pair("report_bias_time_s", TRAFFIC.report_bias_time_s, lambda s: s.traffic.adsb.position.time),
    Pair("report_bias_m", TRAFFIC.report_bias_m, lambda s: s.traffic.adsb.position.sigma, False),
    Pair("gnss_range_sigma_m", TRAFFIC.gnss_range_sigma_m, lambda s: s.traffic.receiver.sigma),
    Pair("gnss_rate_sigma_m_s", TRAFFIC.gnss_rate_sigma_m_s, lambda s: s.traffic.receiver.rate_sigma),
    Pair("radar_glint_m", TRAFFIC.radar_glint_m, lambda s: s.traffic.radar.glint),
    Pair("gust_m_s", TRAFFIC.gust_m_s, lambda s: s.traffic.aircraft[0].turbulence.sigma),
    Pair("gust_time_s", TRAFFIC.gust_time_s, lambda s: s.traffic.aircraft[0].turbulence.time),
    Pair("own_tilt_sigma_deg", TRAFFIC.own_tilt_sigma_deg, lambda s: s.nav.attitude_deg.sigma),
    Pair("own_attitude_time_s", TRAFFIC.own_attitude_time_s, lambda s: s.nav.attitude_deg.time),
    Pair("own_position_sigma_m", TRAFFIC.own_position_sigma_m, lambda s: s.nav.position.sigma),
    Pair("own_position_time_s", TRAFFIC.own_position_time_s, lambda s: s.nav.position.time),
    Pair("own_velocity_sigma_m_s", TRAFFIC.own_velocity_sigma_m_s, lambda s: s.nav.velocity.sigma),
)
EVERY = (
    *(("formation", pair) for pair in FORMATION),
    *(("quadrotor", pair) for pair in QUADROTOR),
    *(("traffic", pair) for pair in TRAFFIC_SCENE),
)
ENCOUNTERS = tuple(pair for pair in FORMATION if pair.name not in ("tilt_sigma_deg", "bank"))


def test_gimbals_of_encounters_are_drawn_around_the_defaults() -> None:
    tilt, yaw, _ = mount_errors([CameraConfig(gimbal=1)])
    for default, (least, most) in ((tilt, GIMBAL_TILT_ERROR_DEG), (yaw, GIMBAL_YAW_ERROR_DEG)):
        assert least < default < most


@cache
def runs(scenario: str) -> list[Scenario]:
    return [draw_scenario(load_scenario(scenario), seed) for seed in SEEDS]


@pytest.mark.parametrize(("scenario", "pair"), EVERY, ids=lambda x: x if isinstance(x, str) else x.name)
def test_no_run_is_flown_at_a_default_seeds_1_to_60(scenario: str, pair: Pair) -> None:
    values = [pair.simulated(run) for run in runs(scenario)]
    assert not np.isclose(values, pair.default, rtol=1e-6).any()
    assert len(set(values)) == len(SEEDS)
    assert (min(values) < pair.default < max(values)) == pair.is_around


@pytest.mark.parametrize("pair", ENCOUNTERS, ids=lambda pair: pair.name)
def test_encounters_are_drawn_around_the_defaults_seed_9(pair: Pair) -> None:
    rng = np.random.default_rng(9)
    values = [pair.simulated(draw_scenario(draw_conditions(rng).scenario, seed)) for seed in SEEDS]
    assert not np.isclose(values, pair.default, rtol=1e-6).any()
    assert min(values) < pair.default < max(values)


@pytest.mark.parametrize("scenario", ["formation", "quadrotor-motor", "traffic", "traffic-gnss"])
def test_what_is_drawn_depends_on_the_seed_alone_seeds_3_and_4(scenario: str) -> None:
    one, again, other = (draw_scenario(load_scenario(scenario), seed) for seed in (3, 3, 4))
    assert one == again != other
    assert draw_scenario(one, 5) == one  # it is drawn once


def test_a_scenario_without_spread_is_flown_as_it_is_written() -> None:
    plain = load_scenario("formation-s-turn")
    assert draw_scenario(plain, 1) is plain

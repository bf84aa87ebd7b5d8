"""What a scenario's leader and rangefinder say beside the images: broadcasts, ADS-B and ranges."""

import math
from itertools import islice
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.geometry.geodesy import ned_from_geodetic
from onboard.messages import AdsbVehicle, Datagram, DistanceReading, GlobalPosition, Truth
from onboard.wire.datagrams import DatagramDecoder
from simlink.scenarios.camera import Camera
from simlink.scenarios.describe import daemon_config
from simlink.scenarios.profiles import GaussMarkov
from simlink.scenarios.rangefinder import Rangefinder
from simlink.scenarios.scenario import Scenario, load_scenario
from simlink.scenarios.traffic import Broadcast
from simlink.sensors.rangefinder import COMPONENT_ID, RangefinderSensor
from simlink.simulation import Event, datagrams, simulate
from simlink.world.truth import states

EXACT: dict[str, Any] = {
    "position": GaussMarkov(sigma=0.0, time=60.0),
    "position_white": 0.0,
    "velocity_white": 0.0,
    "p_lose": 0.0,
}


def events(scenario: Scenario, kind: type, seconds: float, seed: int = 1) -> list[Event]:
    return [e for e in simulate(scenario, seed, seconds) if isinstance(e.message, kind)]


def places(scenario: Scenario, seconds: float, seed: int = 1) -> dict[float, Any]:
    """Where the leader was, by time of flight to the hundredth of a second."""
    steps = islice(states(scenario, seed), 0, round(200 * seconds) + 1, 2)
    return {round(state.t, 2): np.array(state.r_OL_n) for state in steps}


def broadcasting(**changed: Any) -> Scenario:
    return Scenario(broadcast=Broadcast(**EXACT | {"latency": (0.3, 0.3)} | changed))


def test_a_leader_broadcasts_where_it_was_once_a_second_from_its_own_system() -> None:
    scenario = broadcasting()
    sent = [e for e in events(scenario, GlobalPosition, 10.0) if e.sender == (100, 1)]
    assert len(sent) == 9  # the first is on its way within a second, and arrives 0.3 s later
    assert np.diff([e.t_ns for e in sent]).tolist() == pytest.approx([1e9] * 8)
    boot_ns, where = round(scenario.vehicle.boot * 1e9), places(scenario, 10.0)
    for e in sent:
        assert isinstance(e.message, GlobalPosition)
        m = e.message
        r = ned_from_geodetic((m.lat_deg, m.lon_deg, m.alt_msl), scenario.vehicle.origin)
        assert np.linalg.norm(np.array(r) - where[round((e.t_ns - boot_ns) * 1e-9 - 0.3, 2)]) < 0.3


def test_as_adsb_it_comes_through_our_receiver_in_steps() -> None:
    sent = events(broadcasting(says="adsb"), AdsbVehicle, 5.0)
    assert {e.sender for e in sent} == {(1, 156)}
    assert {e.message.icao for e in sent if isinstance(e.message, AdsbVehicle)} == {0x4B19FF}
    steps = [e.message.altitude / 7.62 for e in sent if isinstance(e.message, AdsbVehicle)]
    assert steps == pytest.approx(np.round(steps))


@pytest.mark.parametrize(
    ("name", "section"),
    [
        ("formation-broadcast", "[estimator.leader.broadcast]\nsystem = 100\ntrusted = true"),
        ("formation-adsb", '[estimator.leader.broadcast]\nicao = "4b19ff"\ntrusted = true'),
        ("formation-range", "[estimator.leader.range]\nsensor = 1"),
    ],
)
def test_a_daemon_is_told_whose_they_are(name: str, section: str) -> None:
    assert section in daemon_config(load_scenario(name))


def sensor(**changed: Any) -> RangefinderSensor:
    settings = Rangefinder(**{"white": 0.0, "bias": 0.0, "p_miss": 0.0} | changed)
    return RangefinderSensor(settings, Camera(), 1)


def test_a_rangefinder_measures_from_the_camera_to_the_leader_with_its_bias() -> None:
    state = next(states(Scenario(), 1))
    distance = math.dist(state.r_OL_n, state.r_OF_n)
    exact = sensor().measure(state, 5, 7)
    assert (exact.distance, exact.sensor, exact.system, exact.component) == (
        pytest.approx(distance),
        1,
        7,
        COMPONENT_ID,
    )
    biased = sensor(bias=0.5)
    readings = [biased.measure(state, 5, 7).distance for _ in range(3)]
    assert len(set(readings)) == 1
    assert abs((readings[0] or 0.0) - distance) > 0.01
    noisy = sensor(white=0.1)
    found = [noisy.measure(state, 5, 7).distance or 0.0 for _ in range(400)]
    assert np.std(found) == pytest.approx(0.1, rel=0.15)


def test_beyond_its_range_and_its_beam_and_now_and_then_it_measures_nothing() -> None:
    state = next(states(Scenario(), 1))
    assert sensor(range_max=20.0).measure(state, 5, 1).distance is None
    assert sensor(half_angle_deg=0.3).measure(state, 5, 1).distance is None
    behind = state._replace(r_OL_n=(state.r_OF_n[0] - 20.0, *state.r_OF_n[1:]))
    assert sensor().measure(behind, 5, 1).distance is None
    often = sensor(p_miss=0.3)
    missed = [often.measure(state, 5, 1).distance is None for _ in range(400)]
    assert np.mean(missed) == pytest.approx(0.3, abs=0.06)


def test_a_rangefinder_s_words_arrive_as_distance_sensor_seed_1() -> None:
    scenario = replace(load_scenario("formation-range"), spread=1.0)
    decoder, found, truths = DatagramDecoder(), [], []
    for each in datagrams(scenario, 1, 3.0):
        if isinstance(each, Datagram):
            found += [m for m in decoder.decode(each) if isinstance(m, DistanceReading)]
        elif isinstance(each, Truth):
            truths.append(math.hypot(*each.r_FL_n))
    assert len(found) in (30, 31)
    measured = [m.distance for m in found if m.distance is not None]
    assert 20 < len(measured) < 31
    assert np.mean(measured) == pytest.approx(np.mean(truths), abs=0.8)

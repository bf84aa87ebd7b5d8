"""simlink's other aircraft: reports and radar detections are their truth with the configured errors."""

import math
from collections import Counter
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from onboard.geometry.geodesy import ned_from_geodetic
from onboard.geometry.rotations import matrix_from_quaternion
from onboard.messages import (
    AdsbVehicle,
    GlobalPosition,
    OwnPose,
    RadarDetection,
    RadarDetections,
    TrafficTruth,
    Truth,
    Vec3,
)
from simlink.scenarios.describe import daemon_config
from simlink.scenarios.profiles import Interval
from simlink.scenarios.scenario import ScenarioError, load_scenario, parse_scenario
from simlink.scenarios.traffic import TrafficRadar
from simlink.simulation import Event, datagrams, simulate
from simlink.traffic.radar import RadarSensor

SEED = 2
HEAD = """
[leader]
a_lat = { mean = 0.0 }
[traffic.radar]
jammed = [{ start = 8.0, end = 10.0 }]
lost = [{ start = 10.0, end = 12.0 }]
[[traffic.aircraft]]
name = "one"
start = [900.0, 200.0, -150.0]
speed = 40.0
course_deg = 90.0
climb = 2.0
silent_from = 15.0
[[traffic.aircraft]]
name = "two"
says = "peer"
start = [400.0, -300.0, -80.0]
speed = 10.0
[[traffic.aircraft]]
name = "three"
says = "nothing"
start = [2000.0, 0.0, -100.0]
speed = 25.0
a_lat = { mean = 2.5 }
"""


@cache
def flight(extra: str = "", seed: int = SEED) -> tuple[Event, ...]:
    return tuple(simulate(parse_scenario(HEAD + extra, "test"), seed, 25.0, "none"))


def of(kind: type, events: tuple[Event, ...]) -> list[tuple[float, object]]:
    return [(e.t_ns * 1e-9 - 40.0, e.message) for e in events if isinstance(e.message, kind)]


def truths(events: tuple[Event, ...]) -> list[TrafficTruth]:
    return [e.message for e in events if isinstance(e.message, TrafficTruth)]


def relative(events: tuple[Event, ...], k: int, t: float) -> np.ndarray:
    """True position of aircraft k from us."""
    all_ = truths(events)
    times = [x.t_ns * 1e-9 - 40.0 for x in all_]
    return np.array([np.interp(t, times, [x.intruders[k].r_FT_n[i] for x in all_]) for i in range(3)])


def test_the_truth_is_consistent_and_turns_right() -> None:
    events = flight()
    for a, b in pairwise(truths(events)):
        dt = (b.t_ns - a.t_ns) * 1e-9
        assert dt == pytest.approx(0.1)
        for x, y in zip(a.intruders, b.intruders, strict=True):
            mean = (np.array(x.v_FT_n) + np.array(y.v_FT_n)) / 2
            np.testing.assert_allclose(np.array(y.r_FT_n) - x.r_FT_n, dt * mean, atol=0.02)
    first, last = (next(m for m in (truths(events)[i],)).intruders[2] for i in (0, -1))
    turn = math.remainder(
        math.atan2(last.v_FT_n[1], last.v_FT_n[0] + 21.336)
        - math.atan2(first.v_FT_n[1], first.v_FT_n[0] + 21.336),
        2 * math.pi,
    )
    assert turn == pytest.approx(2.5 / 25.0 * 25.0, abs=0.15)


def test_adsb_reports_the_position_a_latency_ago_within_its_errors() -> None:
    events = flight()
    scenario = parse_scenario(HEAD, "test")
    own = [(e.t_ns * 1e-9 - 40.0, e.message) for e in events if isinstance(e.message, Truth)]
    times = [t for t, _ in own]
    errors = []
    for t, m in of(AdsbVehicle, events):
        assert isinstance(m, AdsbVehicle)
        if m.tslc > 0 or t < 1.0:
            continue
        r_OT = ned_from_geodetic((m.lat_deg or 0.0, m.lon_deg or 0.0, m.altitude or 0.0), scenario.vehicle.origin)
        then = t - 0.4
        r_OF = np.array([np.interp(then, times, [x.r_OF_n[i] for _, x in own]) for i in range(3)])
        errors.append(r_OT - r_OF - relative(events, 0, then))
        assert (m.altitude or 0.0) / 7.62 == pytest.approx(round((m.altitude or 0.0) / 7.62), abs=1e-9)
        assert m.climb == pytest.approx(round((m.climb or 0.0) / 0.3251) * 0.3251)
    off = np.array(errors)
    assert len(off) > 10
    assert np.abs(off[:, 0]).max() < 12.0
    assert np.abs(off[:, 1]).max() < 20.0  # along its course, where 0.2 s of latency are 8 m
    assert np.abs(off[:, 2]).max() < 12.0


def test_a_receiver_repeats_the_last_report_with_its_age_and_then_is_silent() -> None:
    reports = [(t, m) for t, m in of(AdsbVehicle, flight()) if t > 15.7]
    ages = [m.tslc for _, m in reports]  # type: ignore[attr-defined]
    assert ages == sorted(ages)
    assert ages[-1] >= 8.0
    assert len({m.lat_deg for _, m in reports}) <= 2  # type: ignore[attr-defined]
    count = [x.intruders[0].messages for x in truths(flight())]
    assert count[-1] == count[160] > 10


def test_another_vehicle_reports_its_position_with_its_own_system_number() -> None:
    peers = [e for e in flight() if isinstance(e.message, GlobalPosition) and e.sender is not None]
    assert {e.sender for e in peers} == {(102, 1)}
    assert len(peers) == pytest.approx(125, abs=12)


def test_the_radar_sees_in_body_axes_with_its_glint_its_misses_and_its_false_alarms_seed_2() -> None:
    events = flight()
    poses = {e.t_ns: e.message for e in events if isinstance(e.message, Truth)}
    offs, false_alarms, hits, scans = [], 0, 0, 0
    for e in events:
        if not isinstance(e.message, RadarDetections) or e.t_ns not in poses:
            continue
        t = e.t_ns * 1e-9 - 40.0
        if 8.0 <= t < 12.0:
            continue
        scans += 1
        R_nb = matrix_from_quaternion(poses[e.t_ns].q_nF)
        left = list(e.message.detections)
        assert all(abs(d.azimuth) <= math.pi for d in left)
        for k in range(3):
            expected = polar_of(R_nb.T @ relative(events, k, t))
            near = [
                d
                for d in left
                if abs(d.range - expected[0]) < 10.0
                and abs(math.remainder(d.azimuth - expected[1], 2 * math.pi)) < 0.05
            ]
            if near:
                hits += 1
                left.remove(near[0])
                d = near[0]
                off = np.array([d.range, d.azimuth, d.elevation]) - expected
                assert d.sigma is not None
                offs.append(off / np.hypot(d.sigma, np.array([1.0, 1.0, 1.0]) / [1.0, d.range, d.range]))
        false_alarms += len(left)
    assert scans > 100
    assert hits / (3 * scans) == pytest.approx(0.9, abs=0.05)
    assert false_alarms / scans == pytest.approx(2.0, abs=0.4)
    # the errors agree with the reported sigmas and a metre of glint on each axis
    assert np.array(offs).std(axis=0) == pytest.approx([1.0, 1.0, 1.0], rel=0.12)
    assert np.abs(np.array(offs).mean(axis=0)) == pytest.approx([0, 0, 0], abs=0.2)


def polar_of(r: np.ndarray) -> np.ndarray:
    x, y, z = r
    return np.array([math.sqrt(x * x + y * y + z * z), math.atan2(y, x), math.atan2(-z, math.hypot(x, y))])


def scans(radar: RadarSensor, r_n: Vec3, t: float = 0.0) -> list[RadarDetection]:
    """The detections of one aircraft in a hundred scans."""
    level = (1.0, 0.0, 0.0, 0.0)
    both = [radar.scan(t, 0, level, [r_n]) for _ in range(100)]
    return [m.detections[0] for m, hit in both if hit[0]]


def quiet(**changes: object) -> RadarSensor:
    plain: dict[str, object] = {"false_alarms": 0.0, "jammed_false_alarms": 0.0, "p_detect": 1.0, "glint": 0.0}
    return RadarSensor(TrafficRadar(**plain | changes), 1)


def test_a_jammer_weakens_distant_echoes_more_and_the_reported_accuracy_shows_it() -> None:
    jammed = quiet(jammed=(Interval(start=8.0, end=10.0),))
    clear, near, far = (scans(jammed, (r, 0.0, 0.0), t) for r, t in ((4000.0, 0.0), (1000.0, 9.0), (4000.0, 9.0)))
    assert len(clear) == 100
    assert len(near) > len(far) > 50
    snr = [np.mean([d.snr_db for d in seen if d.snr_db is not None]) for seen in (clear, near, far)]
    assert snr == pytest.approx([74.9, 32.2, 19.8], abs=3.0)  # of Table 4 by hand; the beam rests 20 degrees up
    sigma = [np.mean([d.sigma for d in seen if d.sigma is not None], axis=0) for seen in (clear, near, far)]
    assert (sigma[2] > sigma[0]).all()


def test_a_panel_sees_worse_aslant_and_every_way_round_is_on_one() -> None:
    ahead, aslant, behind = (
        scans(quiet(), (3000.0 * math.cos(a), 3000.0 * math.sin(a), 0.0)) for a in (0.0, math.pi / 3, math.pi)
    )
    assert len(ahead) == len(aslant) == len(behind) == 100
    assert aslant[0].snr_db == pytest.approx(ahead[0].snr_db - 7.5, abs=0.3)  # 25 lg cos 60°
    assert behind[0].snr_db == pytest.approx(aslant[0].snr_db)
    assert not scans(quiet(), (100.0, 0.0, 1000.0))  # straight below, out of the scan


def test_a_jammed_radar_has_false_alarms_and_one_without_signal_has_nothing() -> None:
    counts = {t: len(m.detections) for t, m in of(RadarDetections, flight())}  # type: ignore[attr-defined]
    assert np.mean([n for t, n in counts.items() if 8.0 <= t < 10.0]) > 9.0
    assert {n for t, n in counts.items() if 10.0 <= t < 12.0} == {0}
    seen = [x.intruders[2].detections for x in truths(flight())]
    assert seen[119] - seen[101] == 0
    assert seen[60] > 40


def test_the_same_seed_gives_the_same_bytes_and_one_more_aircraft_leaves_the_others_as_they_were() -> None:
    scenario = parse_scenario(HEAD, "test")
    runs = [
        [d.data for d in datagrams(scenario, 3, 4.0, "none") if not isinstance(d, Truth | TrafficTruth)]
        for _ in range(2)
    ]
    assert runs[0] == runs[1]
    more = '[[traffic.aircraft]]\nname = "four"\nstart = [100.0, 900.0, -150.0]\n'
    a, b = truths(flight())[-1].intruders, truths(flight(more))[-1].intruders
    assert a[0].r_FT_n == b[0].r_FT_n
    assert len(b) == 4


def test_the_scenario_traffic_agrees_with_its_description() -> None:
    scenario = load_scenario("traffic")
    says = Counter(a.says for a in scenario.traffic.aircraft)
    assert says == {"adsb": 13, "peer": 2, "nothing": 5}
    assert len(scenario.traffic.radar.jammed) == 1
    assert sum(a.silent_from is not None for a in scenario.traffic.aircraft) == 1
    assert "[estimator.traffic]" in daemon_config(scenario)
    assert "[estimator.traffic]" not in daemon_config(load_scenario("formation"))
    truth = truths(tuple(simulate(scenario, 1, 0.1, "none")))[0]
    assert isinstance(truth, TrafficTruth)
    assert not isinstance(truth, OwnPose)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('[[traffic.aircraft]]\nname = "a"', "start"),
        ('[[traffic.aircraft]]\nname = "a"\nstart = [0, 0]', "start"),
        ('[[traffic.aircraft]]\nname = "a"\nstart = [0, 0, 0]\nspeed = 0.0', "speed"),
        ('[[traffic.aircraft]]\nname = "a"\nstart = [0, 0, 0]\nwings = 2', "wings"),
        ("[traffic.radar]\njammed = [{ start = 5.0, end = 2.0 }]", "jammed"),
        (2 * '[[traffic.aircraft]]\nname = "a"\nstart = [0, 0, 0]\n', "name of its own"),
    ],
)
def test_an_invalid_scene_names_the_key(text: str, message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        parse_scenario(text, "test")

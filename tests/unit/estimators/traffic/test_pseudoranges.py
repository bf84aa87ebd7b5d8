"""Pseudoranges of other aircraft: the almanac, the wire format, the fix, and their tracks."""

import math
import tomllib
from pathlib import Path

import msgspec
import numpy as np
import pytest

from onboard.config import parse_config
from onboard.estimators.traffic.pseudoranges import solve
from onboard.geometry.geodesy import ecef_from_geodetic, geodetic_from_ecef, rotation_ne
from onboard.messages import Clock, Estimate, Pseudoranges, Reason, SatelliteRange, TrafficTruth, Truth, Verdict
from onboard.pipeline import Pipeline
from onboard.wire.documents.document import BadDocumentError
from onboard.wire.documents.pseudoranges import decode_ranges
from simlink.scenarios.describe import daemon_config
from simlink.scenarios.scenario import load_scenario
from simlink.sensors import almanac, gnss
from simlink.simulation import datagrams
from studies.traffic.scores import TrafficScore, score_traffic
from tests.support.traffic import Sky

GPS = almanac.load()
PLACE = ecef_from_geodetic(47.4, 8.5, 500.0)


# ------------------------------------------------------------------------------------------- almanac


def test_the_almanac_is_of_thirty_one_healthy_satellites() -> None:
    assert len(GPS.names) == 31  # thirteen was not
    assert "G13" not in GPS.names
    assert (np.abs(np.degrees(GPS.inclination) - 55.0) < 2.5).all()
    assert GPS.eccentricity.max() < 0.022


def test_orbits_are_ellipses_and_velocities_their_slopes() -> None:
    then, now, later = (almanac.satellites(GPS, t).position for t in (70_000.0, 70_000.1, 70_000.2))
    np.testing.assert_allclose(almanac.satellites(GPS, 70_000.1).velocity, (later - then) / 0.2, atol=1e-3)
    r = np.linalg.norm(now, axis=1) / GPS.root_axis**2
    assert (np.abs(r - 1.0) <= GPS.eccentricity + 1e-12).all()
    day = 86_164.0905  # s, sidereal
    again = almanac.satellites(GPS, 70_000.1 + day).position
    assert np.linalg.norm(again - now, axis=1).max() < 60e3  # twice round while the Earth turns once


def test_one_place_by_hand() -> None:
    """IS-GPS-200's steps for PRN 21, nearly a circle, at the almanac's own time: E of the mean anomaly to first
    order in e, the node less the Earth's turn since the week began."""
    k = GPS.names.index("G21")
    e, M, w = 0.0007863044739, 3.070704840, -0.078260734
    nu = M + 2 * e * math.sin(M)
    r, u = 5153.544922**2 * (1 - e * math.cos(M)), nu + w
    node, i = 1.499487567 - 7.2921151467e-5 * 61440.0, 0.9641752353
    expected = (
        r * (math.cos(u) * math.cos(node) - math.sin(u) * math.cos(i) * math.sin(node)),
        r * (math.cos(u) * math.sin(node) + math.sin(u) * math.cos(i) * math.cos(node)),
        r * math.sin(u) * math.sin(i),
    )
    np.testing.assert_allclose(almanac.satellites(GPS, 61440.0).position[k], expected, atol=60.0)  # e^2 a: 16 m


@pytest.mark.parametrize("line", ["Mean Anom(rad)", "ID", "Health"])
def test_a_damaged_almanac_is_refused(line: str) -> None:
    text = almanac.ALMANAC_PATH.read_text()
    with pytest.raises(ValueError, match="almanac"):
        almanac.read(text.replace(line, "Nonsense", 1))
    with pytest.raises(ValueError, match="no healthy"):
        almanac.read("")


# ----------------------------------------------------------------------------------------------- wire


def seen_from(r_e: np.ndarray, v_e: np.ndarray, seed: int, clock: float = 1e5) -> tuple[SatelliteRange, ...]:
    """A receiver's measurements there; its clock's drift is a ten-thousandth of its error."""
    rng, sky = np.random.default_rng(seed), almanac.satellites(GPS, 62_000.0)
    found = []
    for k in np.flatnonzero(gnss.elevations(sky.position, r_e) > math.radians(10)):
        line, rate = sky.position[k] - r_e, sky.velocity[k] - v_e
        distance = float(np.linalg.norm(line))
        found.append(
            SatelliteRange(
                satellite=GPS.names[k],
                r_e=tuple(sky.position[k].tolist()),
                v_e=tuple(sky.velocity[k].tolist()),
                pseudorange=distance + clock + 5.0 * rng.standard_normal(),
                rate=float(line @ rate) / distance + 1e-4 * clock + 0.1 * rng.standard_normal(),
                sigma=5.0,
                rate_sigma=0.1,
            )
        )
    return tuple(found)


EPOCH = Pseudoranges(t_ns=5, clock=Clock.BOOT, peer=7, satellites=seen_from(PLACE, np.zeros(3), 1))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"peer": 0}, r"\$\.peer"),
        ({"t_ns": 2**70}, "t_ns"),
        ({"satellites": EPOCH.satellites * 2}, "each once"),
        ({"satellites": (msgspec.structs.replace(EPOCH.satellites[0], r_e=(1.0, 2.0, 3.0)),)}, r"satellites\[0\]"),
        ({"satellites": (msgspec.structs.replace(EPOCH.satellites[0], sigma=0.0),)}, r"satellites\[0\]"),
        ({"satellites": (msgspec.structs.replace(EPOCH.satellites[0], rate=1e6),)}, r"satellites\[0\]"),
    ],
)
def test_an_impossible_epoch_is_refused_with_the_field_s_name(change: dict[str, object], reason: str) -> None:
    with pytest.raises(BadDocumentError, match=reason):
        decode_ranges(msgspec.json.encode(msgspec.structs.replace(EPOCH, **change)), 0)


def test_a_satellite_that_cannot_be_used_costs_the_others_nothing() -> None:
    first, *others = EPOCH.satellites
    odd = msgspec.structs.replace(first, sigma=0.0)
    reasons: list[Reason] = []
    sent = msgspec.structs.replace(EPOCH, satellites=(odd, *others))
    m = decode_ranges(msgspec.json.encode(sent), 9, reasons.append)
    assert m.satellites == tuple(others)
    data = msgspec.json.encode(EPOCH).replace(b'"sigma":5.0', b'"sigma":NaN', 1)
    assert decode_ranges(data, 9, reasons.append).satellites == tuple(others)
    assert [why.words.split(" - at ")[1] for why in reasons] == [
        "`$.satellites[0]`",
        "`$.satellites[0].sigma`",
    ]


# ------------------------------------------------------------------------------------------------ fix


def test_a_fix_is_consistent_with_its_covariance_seeds_0_to_199() -> None:
    v_e, near = np.array([10.0, -20.0, 5.0]), PLACE + np.array([3e3, -5e3, 2e3])
    off = []
    for seed in range(200):
        fix = solve(seen_from(PLACE, v_e, seed), near, 5.0, 0.1)
        assert fix.agree
        e = fix.y - np.concatenate([PLACE, v_e])
        off.append(float(e @ np.linalg.solve(fix.R, e)))
    assert np.mean(off) == pytest.approx(6.0, abs=0.75)  # three sigmas of the mean of 200


def test_three_satellites_leave_one_direction_open() -> None:
    fix = solve(seen_from(PLACE, np.zeros(3), 3)[:3], PLACE + np.array([30.0, -20.0, 10.0]), 5.0, 0.1)
    widths = np.sqrt(np.linalg.eigvalsh(fix.R[:3, :3]))
    assert widths[0] < 5.7
    assert widths[2] > 7500.0
    e = fix.y[:3] - PLACE
    assert float(e @ np.linalg.solve(fix.R[:3, :3], e)) < 16.0


def test_a_satellite_with_a_false_range_is_noticed() -> None:
    satellites = seen_from(PLACE, np.zeros(3), 4)
    faulty = msgspec.structs.replace(satellites[2], pseudorange=satellites[2].pseudorange + 200.0)
    assert not solve((*satellites[:2], faulty, *satellites[3:]), PLACE, 5.0, 0.1).agree


# ---------------------------------------------------------------------------------------------- tracks


def share(sky: Sky, r: np.ndarray, v: np.ndarray, seed: int, **changes: object) -> None:
    """A peer at r from home, NED, shares its pseudoranges now."""
    e_from_n = rotation_ne(*sky.home[:2]).T
    satellites = seen_from(ecef_from_geodetic(*sky.geodetic(r)), e_from_n @ v, seed)
    t_ns = round(sky.t * 1e9)
    epoch = Pseudoranges(t_ns=t_ns, clock=Clock.BOOT, peer=7, satellites=satellites)
    m = decode_ranges(msgspec.json.encode(msgspec.structs.replace(epoch, **changes)), t_ns)
    sky.estimator.observe(m, sky.ownship)


def test_a_peer_is_tracked_by_its_pseudoranges_under_its_number() -> None:
    sky, r, v = Sky(), np.array([800.0, -300.0, -60.0]), np.array([-20.0, 5.0, 0.0])
    for k in range(10):
        share(sky, r + v * k, v, k)
        sky.fly(1.0)
    e = sky.newest["system/7"]
    assert e.mean is not None
    assert e.covariance is not None
    off = np.array(e.mean[:3]) - (r + 10 * v - sky.own())
    assert np.linalg.norm(off) < 2.4
    assert e.intruder is not None
    assert e.intruder.sources == ("gnss",)


def test_too_few_or_faulty_satellites_begin_no_track() -> None:
    sky, r, v = Sky(), np.array([800.0, -300.0, -60.0]), np.zeros(3)
    full = seen_from(ecef_from_geodetic(*sky.geodetic(r)), v, 1)
    share(sky, r, v, 1, satellites=full[:3])
    share(sky, r, v, 1, satellites=())
    faulty = msgspec.structs.replace(full[0], pseudorange=full[0].pseudorange + 500.0)
    share(sky, r, v, 1, satellites=(faulty, *full[1:]))
    sky.fly(0.5)
    assert sky.verdicts == {str(Verdict.NO_POSITION): 2, str(Verdict.IMPLAUSIBLE): 1}
    assert not sky.newest


def test_its_height_is_above_the_geoid() -> None:
    sky = Sky(geoid_undulation_m=48.0)
    for k in range(8):
        share(sky, np.array([500.0, 0.0, 0.0]), np.zeros(3), k)
        sky.fly(1.0)
    intruder = sky.newest["system/7"].intruder
    assert intruder is not None
    height = geodetic_from_ecef(ecef_from_geodetic(*sky.geodetic(np.array([500.0, 0.0, 0.0]))))[2]
    assert intruder.alt_msl == pytest.approx(height - 48.0, abs=8.0)


def fly(seed: int) -> tuple[TrafficScore, Pipeline]:
    scenario = load_scenario("traffic-gnss")
    config = tomllib.loads(daemon_config(scenario))
    del config["estimator"]["leader"]
    pipeline = Pipeline(parse_config(config))
    truth: list[TrafficTruth] = []
    estimates: list[Estimate] = []
    for item in datagrams(scenario, seed, None, "none"):
        if isinstance(item, TrafficTruth):
            truth.append(item)
        elif not isinstance(item, Truth):
            estimates += [e for e in pipeline.feed(item) if isinstance(e, Estimate)]
    return score_traffic(estimates, truth), pipeline


def test_the_almanac_comes_with_the_package() -> None:
    assert "data/*.alm" in Path("pyproject.toml").read_text()

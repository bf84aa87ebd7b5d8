"""The tracker: what it makes of reports and echoes, where on Earth that may be, and what it refuses and why."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.estimators.traffic import Config, Estimator
from onboard.messages import AltitudeType, Lifecycle, PeerPosition, RadarScan, ThreatLevel
from tests.traffic import CAMERA, HOME, ICAO, S, Sky, mean

NAME = f"icao/{ICAO:06x}"
R0, V0 = np.array([2000.0, -500.0, -100.0]), np.array([-30.0, 20.0, 1.0])
NORTH, EAST = np.eye(3)[0], np.eye(3)[1]


def follow(sky: Sky, seconds: int, r0: np.ndarray = R0, v: np.ndarray = V0, **changes: object) -> None:
    """Reports at 1 Hz of an aircraft on a straight line."""
    for _ in range(seconds):
        sky.hear(sky.adsb(r0 + v * sky.t, v, **changes))
        sky.fly(1.0)


def scan(sky: Sky, scans: int, *lines: tuple[np.ndarray, np.ndarray]) -> None:
    """Scans at 10 Hz of aircraft on straight lines."""
    for _ in range(scans):
        sky.see([r + v * sky.t for r, v in lines])
        sky.fly(0.1)


# ------------------------------------------------------------------------------------ a plain track


@pytest.mark.parametrize("filter_", ["kf", "ekf", "ukf", "srukf", "imm"])
def test_reports_alone_give_position_and_velocity_relative_to_us(filter_: str) -> None:
    sky = Sky(speed=20.0, course_deg=30.0, filter=filter_)
    follow(sky, 12)
    e = sky.told[NAME]
    assert (e.state, e.valid, e.name) == (Lifecycle.TRACKING, True, "traffic")
    own_v = sky.own() / sky.t
    np.testing.assert_allclose(mean(e)[:3], R0 + V0 * sky.t - sky.own(), atol=1.5)
    np.testing.assert_allclose(mean(e)[3:], V0 - own_v, atol=0.3)
    assert e.intruder is not None
    assert (e.intruder.icao, e.intruder.system, e.intruder.sources) == (ICAO, None, ("adsb",))
    np.testing.assert_allclose(e.intruder.v_n, V0, atol=0.3)
    lat, lon, height = sky.geodetic(R0 + V0 * sky.t)
    assert (e.intruder.lat_deg, e.intruder.lon_deg) == (pytest.approx(lat, abs=2e-5), pytest.approx(lon, abs=3e-5))
    assert e.intruder.alt_msl == pytest.approx(height, abs=2.0)


@pytest.mark.parametrize("filter_", ["kf", "ekf", "ukf", "srukf", "imm"])
def test_a_radar_alone_makes_a_track_and_finds_its_velocity(filter_: str) -> None:
    sky = Sky(speed=20.0, course_deg=60.0, filter=filter_)
    scan(sky, 100, (R0, V0))
    (e,) = [e for e in sky.told.values() if e.valid]
    assert e.target.startswith("radar/")
    np.testing.assert_allclose(mean(e)[:3], R0 + V0 * sky.t - sky.own(), atol=3.0)
    np.testing.assert_allclose(mean(e)[3:] + sky.own() / sky.t, V0, atol=1.5)
    assert sky.verdicts["fused"] == 99


def test_the_age_of_a_report_is_taken_into_account() -> None:
    """4 s old, a report of 60 m/s is of a place 240 m behind."""
    sky, fast = Sky(adsb_latency_s=0.0, max_tslc_s=10.0), np.array([60.0, 0.0, 0.0])
    for _ in range(8):
        sky.hear(sky.adsb(R0 + fast * (sky.t - 4.5), fast, tslc=4.0))
        sky.fly(1.0)
    np.testing.assert_allclose(mean(sky.told[NAME])[:3], R0 + fast * sky.t, atol=4.0)


def test_what_was_heard_late_is_as_good_as_in_time() -> None:
    prompt, late = Sky(), Sky(adsb_latency_s=0.4)
    for _ in range(10):
        prompt.hear(prompt.adsb(R0 + V0 * prompt.t, V0))
        late.hear(late.adsb(R0 + V0 * (late.t - 0.4), V0))
        prompt.fly(1.0)
        late.fly(1.0)
    np.testing.assert_allclose(mean(late.told[NAME]), mean(prompt.told[NAME]), atol=0.2)


def test_another_vehicle_on_mavlink_is_traffic_by_its_system_number() -> None:
    sky = Sky()
    for _ in range(20):
        lat, lon, height = sky.geodetic(R0 + V0 * sky.t)
        t_ns = round(sky.t * S)
        v = (float(V0[0]), float(V0[1]), float(V0[2]))
        sky.hear(
            PeerPosition(t_ns=t_ns, t_recv_ns=t_ns, system=7, lat_deg=lat, lon_deg=lon, alt_msl=height, v_n=v)
        )
        sky.fly(0.2)
    e = sky.told["system/7"]
    assert e.valid
    assert e.intruder is not None
    assert (e.intruder.system, e.intruder.icao) == (7, None)
    # said to be 0.05 s old
    np.testing.assert_allclose(mean(e)[:3], R0 + V0 * (sky.t + 0.05), atol=0.5)


# --------------------------------------------------------------------------------------- anywhere


@pytest.mark.parametrize(
    "home",
    [
        (0.0, 180.0, 100.0),
        (-17.0, 179.999, 100.0),
        (89.99, 30.0, 100.0),
        (-89.995, -120.0, 3000.0),
        (90.0, 0.0, 100.0),
        (-90.0, 0.0, 100.0),
        (0.0, 0.001, 100.0),
    ],
)
def test_poles_and_antimeridian_are_places_like_others(home: tuple[float, float, float]) -> None:
    """The aircraft flies over the pole, or the antimeridian, or the equator, as it passes us."""
    sky = Sky(home)
    r0, v = np.array([-300.0, 900.0, -50.0]), np.array([10.0, -60.0, 0.0])
    follow(sky, 20, r0, v)
    e = sky.told[NAME]
    np.testing.assert_allclose(mean(e)[:3], r0 + v * sky.t, atol=2.0)
    np.testing.assert_allclose(mean(e)[3:], v, atol=0.4)
    assert set(sky.verdicts) == {"initialising", "fused"}


def test_an_aircraft_at_ninety_north_itself() -> None:
    sky = Sky((89.99, 0.0, 100.0))
    for _ in range(5):
        sky.hear(replace(sky.adsb((0, 0, 0), (0.001, 0, 0)), lat_deg=90.0, lon_deg=-123.0, altitude=600.0))
        sky.fly(1.0)
    e = sky.told[NAME]
    assert mean(e)[0] == pytest.approx(1116.9, abs=3.0)  # 0.01 degree of a meridian near the pole
    assert mean(e)[1] == pytest.approx(0.0, abs=1.0)
    assert e.intruder is not None
    assert e.intruder.lat_deg == pytest.approx(90.0, abs=2e-5)


def test_both_kinds_of_altitude_end_above_mean_sea_level() -> None:
    """48 m of geoid, and a QNH that makes the altimeters read 30 m too little."""
    heights = {}
    for kind in AltitudeType:
        sky = Sky(geoid_undulation_m=48.0, pressure_altitude_offset_m=30.0)
        said = HOME[2] + 300.0 + (48.0 if kind is AltitudeType.GEOMETRIC else -30.0)
        follow(sky, 6, np.array([1000.0, 0.0, 0.0]), np.array([5.0, 0.0, 0.0]), altitude=said, altitude_type=kind)
        heights[kind] = -mean(sky.told[NAME])[2]
    assert heights == {kind: pytest.approx(300.0, abs=1.0) for kind in AltitudeType}


# --------------------------------------------------------------------------------- what is refused


@pytest.mark.parametrize(
    ("changes", "verdict"),
    [
        ({"tslc": 6.0}, "stale"),
        ({"lat_deg": None}, "no_position"),
        ({"lon_deg": None}, "no_position"),
        ({"altitude": None}, "no_position"),
        ({"lat_deg": 91.0}, "implausible"),
        ({"lon_deg": 181.0}, "implausible"),
        ({"lat_deg": math.nan}, "implausible"),
        ({"altitude": 40_000.0}, "implausible"),
        ({"altitude": math.inf}, "implausible"),
        ({"ground_speed": 400.0}, "implausible"),
        ({"climb": math.nan}, "implausible"),
        ({"icao": 0}, "implausible"),
        ({"icao": 0x1000000}, "implausible"),
        ({"icao": 0xABCDEF}, "ourselves"),
    ],
    ids=str,
)
def test_a_report_that_cannot_be_used_is_counted_by_its_reason(changes: dict[str, object], verdict: str) -> None:
    sky = Sky(own_icao="abCDef")
    follow(sky, 3, **changes)
    assert sky.told == {}
    assert sky.verdicts == {verdict: 3}


def test_without_our_own_position_nothing_is_tracked() -> None:
    sky = Sky()
    fresh = Estimator(Config(), CAMERA)
    fresh.observe(sky.adsb(R0, V0), sky.ownship)
    t_ns = round(sky.t * S)
    fresh.observe(RadarScan(t_ns=t_ns, t_recv_ns=0, radar="x", frame="ned", detections=()), sky.ownship)
    assert dict(fresh.verdicts) == {"no_pose": 1}
    assert fresh.tick(sky.ownship) == []


def test_what_a_receiver_says_again_is_no_news() -> None:
    sky = Sky()
    follow(sky, 5)
    last = sky.adsb(R0 + V0 * sky.t, V0)
    sky.hear(last)
    sky.fly(1.0)
    before = sky.told[NAME].age
    for k in (1, 2):
        sky.hear(replace(last, t_ns=round(sky.t * S), tslc=float(k)))
        sky.fly(1.0)
    assert sky.verdicts["duplicate"] == 2
    age = sky.told[NAME].age
    assert before is not None
    assert age is not None
    assert age > before + 1.9


def test_a_spoofed_jump_does_not_move_the_track() -> None:
    sky = Sky()
    follow(sky, 8)
    for jump in (5000.0, -8000.0):
        sky.hear(sky.adsb(R0 + V0 * sky.t + [jump, 0, 0], V0))
        sky.fly(1.0)
        np.testing.assert_allclose(mean(sky.told[NAME])[:3], R0 + V0 * sky.t, atol=3.0)
    assert sky.verdicts["implausible"] == 2
    follow(sky, 3)
    assert set(sky.told) == {NAME}
    assert sky.told[NAME].reset_count == 0


def test_two_aircraft_with_one_address_are_two_tracks() -> None:
    sky, apart = Sky(), np.array([3000.0, 0.0, 0.0])
    follow(sky, 5)
    for _ in range(15):
        sky.hear(sky.adsb(R0 + V0 * sky.t, V0))
        sky.hear(sky.adsb(R0 + apart - V0 * sky.t, -V0))
        sky.fly(1.0)
    first, second = sky.told[NAME], sky.told[f"{NAME}-2"]
    np.testing.assert_allclose(mean(first)[:3], R0 + V0 * sky.t, atol=2.0)
    np.testing.assert_allclose(mean(second)[:3], R0 + apart - V0 * sky.t, atol=2.0)
    assert "address" in first.reason
    assert "address" in second.reason
    assert set(sky.told) == {NAME, f"{NAME}-2"}


def test_a_name_goes_with_its_reports_when_a_radar_sees_somebody_else_in_its_place() -> None:
    """A track that echoes of another aircraft have drawn away; or a transponder that tells lies. Both places are
    tracked, the seen one without a name."""
    sky, off = Sky(), 400.0 * EAST
    for k in range(14):
        sky.hear(sky.adsb(R0 + V0 * sky.t + (off if k >= 6 else 0.0), V0))
        scan(sky, 10, (R0, V0))
    named = sky.told[NAME]
    np.testing.assert_allclose(mean(named)[:3], R0 + V0 * sky.t + off, atol=5.0)
    assert named.reset_count == 1
    (unnamed,) = [e for name, e in sky.told.items() if name.startswith("radar/") and e.valid]
    np.testing.assert_allclose(mean(unnamed)[:3], R0 + V0 * sky.t, atol=5.0)
    assert sum(e.valid for e in sky.told.values()) == 2


def test_an_aircraft_that_did_move_is_found_again_under_its_name() -> None:
    """It turned back while it was not heard: its reports fit each other, nothing contradicts them."""
    sky = Sky(gate_probability=0.99)
    follow(sky, 6)
    turned_at = sky.t
    sky.fly(9.0)
    back = R0 + V0 * turned_at
    for _ in range(6):
        sky.hear(sky.adsb(back - V0 * (sky.t - turned_at) + [400.0, 0, 0], -V0))
        sky.fly(1.0)
    e = sky.told[NAME]
    assert e.reset_count == 1
    np.testing.assert_allclose(mean(e)[:3], back - V0 * (sky.t - turned_at) + [400.0, 0, 0], atol=3.0)
    assert set(sky.told) == {NAME}


def test_there_are_no_more_tracks_than_may_be() -> None:
    sky = Sky(max_tracks=2)
    for k in range(5):
        sky.hear(sky.adsb(R0 + 1000.0 * k * NORTH, V0, icao=k + 1))
    sky.fly(0.2)
    assert len(sky.told) == 2
    assert sky.verdicts == {"initialising": 2, "full": 3}


def test_a_flood_of_reports_costs_its_newest_and_no_memory() -> None:
    sky = Sky()
    report = sky.adsb(R0, V0)
    for _ in range(6000):
        sky.hear(report)
    assert sky.verdicts["full"] == 1000


# ------------------------------------------------------------------------------------- life cycle


def test_a_track_coasts_is_lost_and_is_forgotten_with_a_last_word() -> None:
    sky = Sky()
    follow(sky, 5)
    silent = sky.t - 1.0
    seen: dict[str, float] = {}
    for _ in range(350):
        sky.fly(0.1)
        e = sky.told[NAME]
        seen.setdefault(str(e.state), sky.t - silent)
        assert e.valid is (e.state in (Lifecycle.TRACKING, Lifecycle.COASTING))
    assert list(seen) == ["tracking", "coasting", "lost", "searching"]
    assert [seen[s] for s in ("coasting", "lost", "searching")] == pytest.approx([3.0, 10.0, 30.0], abs=0.2)
    assert sky.told[NAME].mean is None
    count = len(sky.all)
    sky.fly(1.0)
    assert len(sky.all) == count


def test_a_transponder_switched_off_is_followed_by_radar_under_its_name() -> None:
    sky = Sky()
    for _ in range(10):
        sky.hear(sky.adsb(R0 + V0 * sky.t, V0))
        scan(sky, 10, (R0, V0))
    scan(sky, 200, (R0, V0))
    e = sky.told[NAME]
    assert e.valid
    assert e.reason == "by radar/nose"
    np.testing.assert_allclose(mean(e)[:3], R0 + V0 * sky.t, atol=3.0)
    assert set(sky.told) == {NAME}


def test_a_radar_track_takes_the_name_of_the_report_that_fits_it() -> None:
    sky, other = Sky(), (R0 + 800.0 * EAST, V0)
    scan(sky, 50, (R0, V0), other)
    named = set(sky.told)
    assert len(named) == 2
    sky.hear(sky.adsb(R0 + V0 * sky.t, V0))
    scan(sky, 10, (R0, V0), other)
    (gone,) = [n for n in named if sky.told[n].state is Lifecycle.SEARCHING]
    assert sky.told[gone].reason == f"it is {NAME}"
    assert sky.told[NAME].valid
    assert sum(e.valid for e in sky.told.values()) == 2


def test_after_jamming_a_radar_track_is_seen_again_under_its_name_and_false_alarms_do_not_move_it() -> None:
    sky = Sky()
    scan(sky, 60, (R0, V0))
    (name,) = sky.told
    rng = np.random.default_rng(5)
    for _ in range(80):  # nothing but false alarms, close to where it should be
        sky.see(R0 + V0 * sky.t + rng.normal(0, 250.0, (4, 3)))
        sky.fly(0.1)
    np.testing.assert_allclose(mean(sky.told[name])[:3], R0 + V0 * sky.t, atol=40.0)
    scan(sky, 30, (R0, V0))
    assert sky.told[name].state is Lifecycle.TRACKING
    np.testing.assert_allclose(mean(sky.told[name])[:3], R0 + V0 * sky.t, atol=10.0)
    assert [n for n, e in sky.told.items() if e.valid] == [name]


def test_false_alarms_make_no_tracks_seed_3() -> None:
    sky, rng = Sky(), np.random.default_rng(3)
    for _ in range(300):
        sky.see(rng.uniform(-3000, 3000, (8, 3)) * [1, 1, 0.2])
        sky.fly(0.1)
    assert sky.all == []
    assert sky.verdicts["initialising"] > 2000


def test_two_that_cross_keep_their_tracks_seed_4() -> None:
    """Only by radar; 25 m apart where they cross, at an angle of 60 degrees."""
    sky, rng = Sky(), np.random.default_rng(4)
    at = np.array([1200.0, 0.0, -60.0])
    va, vb = np.array([26.0, 15.0, 0.0]), np.array([26.0, -15.0, 0.0])
    lines = [(at - 10 * va, va), (at - 10 * vb + [0, 0, 25.0], vb)]
    names = {}
    for k in range(200):
        places = [r + v * sky.t + rng.normal(0, 3.0, 3) for r, v in lines]
        sky.see([p for p in places if rng.uniform() < 0.9][:: 1 if k % 2 else -1])
        sky.fly(0.1)
        if k == 50:
            names = {n: int(mean(e)[4] < 0) for n, e in sky.told.items() if e.valid}
    assert len(names) == 2
    for name, which in names.items():
        r, v = lines[which]
        np.testing.assert_allclose(mean(sky.told[name])[:3], r + v * sky.t, atol=12.0)


def test_a_reset_forgets_all_and_says_so() -> None:
    sky = Sky()
    follow(sky, 3)
    sky.estimator.reset("the autopilot has rebooted")
    sky.fly(0.2)
    assert (sky.told[NAME].state, sky.told[NAME].reason) == (Lifecycle.SEARCHING, "the autopilot has rebooted")
    follow(sky, 3)
    assert sky.told[NAME].valid


def test_each_track_is_told_ten_times_a_second_and_counts() -> None:
    sky = Sky()
    follow(sky, 10)
    numbers = [e.sequence for e in sky.all]
    assert numbers == list(range(1, len(numbers) + 1))
    assert len(numbers) == pytest.approx(100, abs=2)


def test_closest_approach_and_threat() -> None:
    """Head on at 50 + 20 m/s with 60 m between the lines: in 1400 / 70 s."""
    sky = Sky(speed=20.0)
    r0, v = np.array([1400.0 + 70 * 6.2 - 50 * 0.0, 60.0, 0.0]), np.array([-50.0, 0.0, 0.0])
    follow(sky, 6, r0, v)
    e = sky.told[NAME]
    assert e.intruder is not None
    a = e.intruder.approach
    assert a.time == pytest.approx(20.0, abs=0.2)
    assert a.distance == pytest.approx(60.0, abs=4 * a.distance_sigma)
    assert a.horizontal == pytest.approx(60.0, abs=15.0)
    assert a.vertical == pytest.approx(0.0, abs=15.0)
    assert a.threat is ThreatLevel.HIGH
    assert 1.0 < a.distance_sigma < 30.0


def test_a_configuration_that_does_not_hold_is_refused() -> None:
    with pytest.raises(ValueError, match="coast_after_s"):
        Estimator(Config(coast_after_s=20.0), CAMERA)
    with pytest.raises(ValueError, match="confirm_hits"):
        Estimator(Config(confirm_hits=11), CAMERA)


def test_a_filter_that_fails_is_dropped_and_the_others_fly_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """Break one covariance by hand: it cannot happen by itself, we hope."""
    sky = Sky(filter="ukf")
    for k in (1, 2, 3):
        sky.hear(sky.adsb(R0 + 500.0 * k * NORTH, V0, icao=k))
    sky.fly(0.5)
    batch = sky.estimator._table.batch
    broken = batch._state.covariance.copy()
    broken[1] = -np.eye(15)
    monkeypatch.setattr(batch, "_state", batch._state._replace(covariance=broken))
    sky.fly(0.5)
    assert sky.verdicts["numerical"] == 1
    assert sky.told["icao/000002"].state is Lifecycle.SEARCHING
    assert {n for n, e in sky.told.items() if e.mean is not None} == {"icao/000001", "icao/000003"}

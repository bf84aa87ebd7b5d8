"""The tracker's estimates from reports and from echoes, anywhere on Earth."""

import numpy as np
import pytest

from onboard.messages import AltitudeType, Barometer, Lifecycle, PeerPosition
from onboard.units import NS_PER_S
from tests.support.traffic import HOME, ICAO, NAME, R0, V0, Sky, fly_with_reports, fly_with_scans, mean


@pytest.mark.parametrize("filter_", ["kf", "ekf", "imm"])
def test_reports_alone_give_position_and_velocity_relative_to_us(filter_: str) -> None:
    sky = Sky(speed=20.0, course_deg=30.0, filter=filter_)
    fly_with_reports(sky, 12)
    e = sky.newest[NAME]
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


@pytest.mark.parametrize("filter_", ["ukf", "srukf", "imm"])
def test_a_radar_alone_makes_a_track_and_finds_its_velocity(filter_: str) -> None:
    sky = Sky(speed=20.0, course_deg=60.0, filter=filter_)
    fly_with_scans(sky, 100, (R0, V0))
    (e,) = [e for e in sky.newest.values() if e.valid]
    assert e.target.startswith("radar/")
    np.testing.assert_allclose(mean(e)[:3], R0 + V0 * sky.t - sky.own(), atol=3.0)
    np.testing.assert_allclose(mean(e)[3:] + sky.own() / sky.t, V0, atol=1.5)
    assert sky.verdicts["fused"] == 99


def test_the_age_of_a_report_is_taken_into_account() -> None:
    """4 s old, a report of 60 m/s is of a place 240 m behind."""
    sky, fast = Sky(), np.array([60.0, 0.0, 0.0])
    for _ in range(8):
        sky.receive(sky.adsb(R0 + fast * (sky.t - 4.5), fast, tslc=4.0))
        sky.fly(1.0)
    np.testing.assert_allclose(mean(sky.newest[NAME])[:3], R0 + fast * sky.t, atol=4.0)


def test_another_vehicle_on_mavlink_is_traffic_by_its_system_number() -> None:
    sky = Sky()
    for _ in range(20):
        lat, lon, height = sky.geodetic(R0 + V0 * sky.t)
        t_ns = round(sky.t * NS_PER_S)
        v = (float(V0[0]), float(V0[1]), float(V0[2]))
        sky.receive(
            PeerPosition(t_ns=t_ns, t_recv_ns=t_ns, system=7, lat_deg=lat, lon_deg=lon, alt_msl=height, v_n=v)
        )
        sky.fly(0.2)
    e = sky.newest["system/7"]
    assert e.valid
    assert e.intruder is not None
    assert (e.intruder.system, e.intruder.icao) == (7, None)
    # configured to be 0.05 s old
    np.testing.assert_allclose(mean(e)[:3], R0 + V0 * (sky.t + 0.05), atol=0.5)


def test_each_track_is_published_ten_times_a_second_with_sequence_numbers() -> None:
    sky = Sky()
    fly_with_reports(sky, 10)
    numbers = [e.sequence for e in sky.published]
    assert numbers == list(range(1, len(numbers) + 1))
    assert len(numbers) == pytest.approx(100, abs=2)


@pytest.mark.parametrize(
    "home",
    [
        (0.0, 179.999, 100.0),
        (-89.995, -120.0, 3000.0),
        (90.0, 0.0, 100.0),
    ],
)
def test_poles_and_antimeridian_are_places_like_others(home: tuple[float, float, float]) -> None:
    """The aircraft flies over the pole, or the antimeridian, or the equator, as it passes us."""
    sky = Sky(home)
    r0, v = np.array([-300.0, 900.0, -50.0]), np.array([10.0, -60.0, 0.0])
    fly_with_reports(sky, 20, r0, v)
    e = sky.newest[NAME]
    np.testing.assert_allclose(mean(e)[:3], r0 + v * sky.t, atol=2.0)
    np.testing.assert_allclose(mean(e)[3:], v, atol=0.4)
    assert set(sky.verdicts) == {"initialising", "fused"}


def test_both_kinds_of_altitude_end_above_mean_sea_level() -> None:
    """48 m of geoid, and a QNH that makes the altimeters read 30 m too little."""
    heights = {}
    for kind in AltitudeType:
        sky = Sky(geoid_undulation_m=48.0, pressure_altitude_offset_m=30.0)
        altitude = HOME[2] + 300.0 + (48.0 if kind is AltitudeType.GEOMETRIC else -30.0)
        fly_with_reports(
            sky, 6, np.array([1000.0, 0.0, 0.0]), np.array([5.0, 0.0, 0.0]), altitude=altitude, altitude_type=kind
        )
        heights[kind] = -mean(sky.newest[NAME])[2]
    assert heights == {kind: pytest.approx(300.0, abs=1.0) for kind in AltitudeType}


@pytest.mark.parametrize(("weather", "has_barometer", "sigma"), [(140.0, False, 100.0), (140.0, True, 10.0)])
def test_a_pressure_altitude_is_as_far_off_as_the_weather_or_corrected_by_our_own(
    weather: float, has_barometer: bool, sigma: float
) -> None:
    """At 200 m above us; low pressure makes both altimeters read too much."""
    sky = Sky()
    for _ in range(6):
        if has_barometer:
            t_ns = round(sky.t * NS_PER_S)
            pressure = Barometer(t_ns=t_ns, t_recv_ns=t_ns, pressure_altitude=HOME[2] + weather)
            sky.estimator.observe(pressure, sky.ownship)
        height = HOME[2] + 200.0 + weather
        r = np.array([1000.0 + 5.0 * sky.t, 0.0, 0.0])
        sky.receive(sky.adsb(r, [5.0, 0.0, 0.0], altitude=height, altitude_type=AltitudeType.PRESSURE))
        sky.fly(1.0)
    e = sky.newest[NAME]
    assert e.covariance is not None
    assert e.covariance[2][2] ** 0.5 == pytest.approx(sigma, rel=0.15)
    assert -mean(e)[2] == pytest.approx(200.0 if has_barometer else 340.0, abs=2.0)


@pytest.mark.parametrize(
    ("beside", "slower", "is_own"), [(0.0, 0.0, True), (3.0, 0.0, True), (15.0, 0.0, False), (3.0, 5.0, False)]
)
def test_a_transponder_that_flies_where_we_are_is_ours(beside: float, slower: float, is_own: bool) -> None:
    """Whatever its altitude says; one that has been followed from afar remains another's."""
    sky = Sky(speed=20.0, course_deg=30.0)
    for _ in range(5):
        v = (sky.own() / sky.t) * (1.0 - slower / 20.0)
        sky.receive(sky.adsb(sky.own() + np.array([0.0, beside, 30.0]), v))
        sky.fly(1.0)
    assert (sky.newest == {}) == is_own
    assert ("ourselves" in sky.verdicts) == is_own

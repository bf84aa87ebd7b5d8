"""Simulated radar and GNSS against numbers worked out by hand, tables, and the papers' misprints."""

import numpy as np
import pytest

from onboard.geometry.geodesy import ecef_from_geodetic
from simlink.sensors import constellation, gnss, phased_array, troposphere
from simlink.sensors.phased_array import Radar

RADAR = Radar()
AHEAD = np.array([[0.0, 10e3 * np.cos(np.radians(20)), 10e3 * np.sin(np.radians(20))]])  # in the beam's middle
CLEAR, JAMMED = np.array([False]), np.array([True])


def ratio(r_RT: np.ndarray, jammed: np.ndarray = CLEAR, rain: float = 0.0, radar: Radar = RADAR) -> float:
    seen = phased_array.spherical(r_RT)
    return float(phased_array.signal_to_noise(radar, seen, r_RT[:, 2], rain, jammed)[0])


# --------------------------------------------------------------------------------------------------- radar


def test_the_bandwidth_at_the_largest_scan_is_a_seventh_of_a_gigahertz() -> None:
    assert phased_array.bandwidth(RADAR) == pytest.approx(0.15e9, rel=0.01)


def test_signal_to_noise_by_hand() -> None:
    """Table 4 in decibels: 10 km, straight ahead; 7.2 dB of losses, .1 dB of air, .1 dB of scan."""
    wavelength = 299792458.0 / 3.3e9
    db = 10 * np.log10(2500 * 50e-6) + 2 * 39.5 + 20 * np.log10(wavelength) + 0.1
    db -= 30 * np.log10(4 * np.pi) + 160 + 10 * np.log10(1.380649e-23 * 500) + 7.2
    losses = phased_array.losses_db(RADAR, phased_array.spherical(AHEAD), AHEAD[:, 2])[0]
    assert 7.2 < losses < 7.4
    assert 10 * np.log10(ratio(AHEAD)) == pytest.approx(db - (losses - 7.2), abs=0.01)
    assert db == pytest.approx(51.0, abs=1.0)


def test_the_fourth_power_of_the_range_and_the_second_when_jammed() -> None:
    thin = RADAR._replace(gas_db_km=0.0, jammer_power=1e9)
    assert ratio(AHEAD, radar=thin) / ratio(2 * AHEAD, radar=thin) == pytest.approx(16, rel=1e-3)
    assert ratio(AHEAD, JAMMED, radar=thin) / ratio(2 * AHEAD, JAMMED, radar=thin) == pytest.approx(4, rel=1e-3)


def test_rain_costs_little_at_this_wavelength_and_scan_costs_more() -> None:
    dry, wet = ratio(AHEAD), ratio(AHEAD, rain=50.0)
    assert 10 * np.log10(dry / wet) == pytest.approx(2 * 10 * 1.26e-4 * 50**1.34, rel=1e-6)
    aside = AHEAD[:, [1, 0, 2]] * np.array([np.sin(np.pi / 4) / 1, 1, 1])
    aside[0, 1] = aside[0, 0]  # azimuth 45 degrees
    assert 10 * np.log10(ratio(AHEAD) / ratio(aside)) == pytest.approx(-25 * np.log10(np.cos(np.pi / 4)), abs=0.1)


def test_integration_is_of_pulses_without_phase() -> None:
    loss = 10**0.1
    np.testing.assert_allclose(phased_array.integrated(RADAR, np.array([1e4])), 10 * 1e4 / loss, rtol=1e-3)
    # of weak pulses the sum is weaker than a coherent one's, 10 x
    np.testing.assert_allclose(phased_array.integrated(RADAR, np.array([0.1])), 10 * 0.01 / 1.1 / loss)


def test_accuracy_is_monopulse_noise_and_a_fixed_part() -> None:
    seen = np.array([[10e3, np.radians(60), np.radians(20)]])
    sigma = phased_array.accuracy(RADAR, seen, np.array([50.0]))[0]
    cell, beam = 299792458.0 / (2 * phased_array.bandwidth(RADAR)), np.radians(2.0)
    assert sigma[0] == pytest.approx(cell * np.hypot(0.1, 0.04))
    assert sigma[2] == pytest.approx(beam * np.hypot(1 / 16, 1 / 40))
    assert sigma[1] == pytest.approx(2 * sigma[2])  # the beam is twice as wide at 60 degrees


def test_the_earth_falls_away_from_the_horizon() -> None:
    level = phased_array.elevation_above_horizon(np.array([50e3]), np.array([0.0]))[0]
    assert level == pytest.approx(-50e3 / (2 * 6371e3 * 4 / 3), rel=1e-3)


def test_errors_agree_with_the_reported_sigmas_and_faults_keep_the_noise_seed_1() -> None:
    t = np.arange(4000) * 0.1
    r = np.tile([[3e3, 9e3, 1e3]], (4000, 1))
    faults = phased_array.RadarConditions(jammed=[(100, 200)], lost=[(300, 310)])
    plain = phased_array.measure(RADAR, t, r, np.random.default_rng(1))
    faulty = phased_array.measure(RADAR, t, r, np.random.default_rng(1), faults)
    error = (faulty.y - phased_array.spherical(r)) / faulty.sigma
    np.testing.assert_allclose(np.nanstd(error, axis=0), 1.0, atol=0.05)
    assert faulty.detected.sum() == 3900
    assert np.isnan(faulty.y[3000:3100]).all()
    assert np.array_equal(plain.y[:1000], faulty.y[:1000])
    assert np.array_equal(plain.y[3100:], faulty.y[3100:])
    assert faulty.snr_db[1500] < plain.snr_db[1500] - 20


# ---------------------------------------------------------------------------------------------------- GNSS


def test_orbits_are_half_a_sidereal_day_and_velocities_are_slopes() -> None:
    day = 86_164.0905  # s, sidereal
    then, now, later = (constellation.satellites(t).position for t in (999.9, 1000.0, 1000.1))
    np.testing.assert_allclose(constellation.satellites(1000.0).velocity, (later - then) / 0.2, atol=1e-3)
    np.testing.assert_allclose(np.linalg.norm(now, axis=1), 26559.7e3)
    # twice round in a sidereal day, to the nominal axis' precision
    gap = np.linalg.norm(constellation.satellites(1000.0 + day).position - now, axis=1)
    assert gap.max() < 60e3


def test_enough_satellites_are_up_everywhere_all_day() -> None:
    for lat in (-80.0, -30.0, 0.0, 45.2, 90.0):
        r_e = ecef_from_geodetic(lat, 7.6, 0.0)
        counts = [
            int((gnss.elevations(constellation.satellites(t).position, r_e) > np.radians(5)).sum())
            for t in np.arange(0, 86400, 1800.0)
        ]
        assert min(counts) >= 4, lat
        assert max(counts) <= 12, lat


def test_niell_at_the_zenith_and_low() -> None:
    """One at the zenith; at 5 degrees, 45 N, sea level about 10.15 dry and 10.75 wet (Niell 1996, figure 3)."""
    up, low = np.array([np.pi / 2]), np.array([np.radians(5.0)])
    np.testing.assert_allclose(troposphere.dry_mapping(up, 0.0, 45.0, 28.0), 1.0)
    np.testing.assert_allclose(troposphere.wet_mapping(up, 45.0), 1.0)
    np.testing.assert_allclose(troposphere.dry_mapping(low, 0.0, 45.0, 28.0), 10.15, atol=0.03)
    np.testing.assert_allclose(troposphere.wet_mapping(low, 45.0), 10.75, atol=0.03)
    # the higher, the flatter the air above: longer still
    assert troposphere.dry_mapping(low, 3000.0, 45.0, 28.0) > troposphere.dry_mapping(low, 0.0, 45.0, 28.0)
    # a southern July is a northern January
    np.testing.assert_allclose(
        troposphere.dry_mapping(low, 0.0, -45.0, 28.0 + 365.25 / 2), troposphere.dry_mapping(low, 0.0, 45.0, 28.0)
    )


def test_the_dry_delay_thins_with_altitude_where_the_printed_sign_thickens_it() -> None:
    up = np.array([np.pi / 2])
    low, high = (troposphere.delay(up, h, 45.0, 60.0, 0.0)[0] for h in (0.0, 8000.0))
    assert low == pytest.approx(2.3)
    assert high == pytest.approx(2.3 * np.exp(-0.928))
    assert 2.3 * np.exp(-0.116e-3 * -8000.0) > 5  # z of NED, as printed


def test_multipath_takes_degrees() -> None:
    low, high = gnss.multipath(np.radians([5.0, 90.0]))
    assert low == pytest.approx(0.13 + 0.53 * np.exp(-0.5))
    assert high == pytest.approx(0.13, abs=1e-3)
    printed = 0.13 + 0.53 * np.exp(-np.radians([5.0, 90.0]) / 10)  # hardly depends on the elevation
    assert printed[0] - printed[1] < 0.1


def flight(seconds: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    t = np.arange(round(seconds * 10) + 1) * 0.1
    r_e = ecef_from_geodetic(45.2, 7.6, 1500.0) + np.outer(t, [0.0, 100.0, 0.0])
    return t, r_e, np.tile([0.0, 100.0, 0.0], (len(t), 1))


def test_pseudoranges_are_distance_clock_and_noise_seed_3() -> None:
    t, r_e, v_e = flight(600)
    got = gnss.receive(gnss.Receiver(), t, r_e, v_e, np.random.default_rng(3))
    errors = []
    for k in range(0, len(t), 10):
        fix = got.fixes[k]
        assert fix is not None
        s = len(fix.slots)
        assert 6 <= s <= 8
        assert (gnss.elevations(fix.position, r_e[k]) >= np.radians(10)).all()
        sight, rate = fix.position - r_e[k], fix.velocity - v_e[k]
        distance = np.linalg.norm(sight, axis=1)
        truth = np.concatenate(
            [distance + got.clock[k, 0], np.sum(sight * rate, axis=1) / distance + got.clock[k, 1]]
        )
        errors.append(((fix.y - truth) / fix.sigma).reshape(2, s))
    assert all(f is None for k, f in enumerate(got.fixes) if k % 10)
    both = np.concatenate(errors, axis=1)
    np.testing.assert_allclose(both.std(axis=1), 1.0, atol=0.05)
    np.testing.assert_allclose(both.mean(axis=1), 0.0, atol=0.06)


@pytest.mark.parametrize("dt", [0.1, 5.0])
def test_the_clock_error_grows_as_configured_seeds_0_to_399(dt: float) -> None:
    receiver, none = gnss.Receiver(clock_sigma=0.0, drift_sigma=0.0, clock_walk=0.0), gnss.GnssConditions()
    still = np.zeros(round(10 / dt), bool)
    walking = receiver._replace(clock_walk=0.05)
    for made, walk in ((receiver, 0.0), (walking, 0.05)):
        clocks = [gnss._clock(made, none, still, dt, np.random.default_rng(s))[-1] for s in range(400)]
        found = np.cov(np.array(clocks).T)
        # of a drift that walks, and its integral: however long the steps
        expected = np.array([[walk * 10 + 0.01 * 1000 / 3, 0.01 * 50], [0.01 * 50, 0.01 * 10]])
        np.testing.assert_allclose(found, expected, rtol=0.2)


def test_faults_of_clock_and_signal_seed_4() -> None:
    t, r_e, v_e = flight(60)
    faults = gnss.GnssConditions(degraded=[(20, 30)], lost=[(40, 50)])
    plain = gnss.receive(gnss.Receiver(), t, r_e, v_e, np.random.default_rng(4))
    faulty = gnss.receive(gnss.Receiver(), t, r_e, v_e, np.random.default_rng(4), faults)
    assert np.array_equal(plain.clock[:200], faulty.clock[:200])
    steps = [np.diff(x.clock[200:300, 0]).std() for x in (plain, faulty)]
    assert steps[1] > 3 * steps[0]
    assert all(f is None for f in faulty.fixes[400:500])
    before, after = plain.fixes[550], faulty.fixes[550]
    assert before is not None and after is not None  # noqa: PT018 - the types need both
    shift = faulty.clock[550] - plain.clock[550]
    np.testing.assert_allclose(after.y - before.y, np.repeat(shift, len(before.slots)), atol=1e-6)


def test_what_the_troposphere_costs_uncorrected_seed_5() -> None:
    t, r_e, v_e = flight(1)
    fixes = [
        gnss.receive(gnss.Receiver(corrected=c), t, r_e, v_e, np.random.default_rng(5)).fixes[0]
        for c in (True, False)
    ]
    assert fixes[0] is not None and fixes[1] is not None  # noqa: PT018 - the types need both
    extra = (fixes[1].y - fixes[0].y)[: len(fixes[0].slots)]
    assert 1.9 < extra.min() < extra.max() < 14


@pytest.mark.parametrize(("receiver", "count"), [(gnss.Receiver(), 1), (gnss.Receiver(mask_deg=0.0), 5)])
def test_what_a_receiver_cannot_do_is_refused(receiver: gnss.Receiver, count: int) -> None:
    t, r_e, v_e = flight(1)
    with pytest.raises(ValueError, match="mask"):
        gnss.receive(receiver, t[:count], r_e[:count], v_e[:count], np.random.default_rng(1))

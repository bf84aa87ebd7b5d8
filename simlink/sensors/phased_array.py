"""A phased-array radar with errors by signal-to-noise ratio. De Vivo et al., 5.1.2.

The frame is east, north, up at the radar. Azimuth is clockwise from north, elevation positive up, rad; range in m.

Errata: the paper's S/(J+N) lacks the pulse duration tau (without it watts are divided by joules); the formula that
it calls coherent integration is the non-coherent one; L is given "in dB" and enters as a ratio. Its theta is the
azimuth in the measurement vector but the elevation in the scan loss: here the unscanned beam points to azimuth
theta_r and elevation phi_r of Table 4. For the losses it refers to Curry (2005); they are in `losses_db`.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from simlink.sensors.arrays import Array, Flags, within

SPEED_OF_LIGHT = 299792458.0  # m/s
BOLTZMANN_CONSTANT = 1.380649e-23  # J/K
EFFECTIVE_EARTH_RADIUS = 6371e3 * 4 / 3  # m; refraction of radio waves acts like a larger Earth


class Radar(NamedTuple):
    """The parameters of Table 4, and those that the paper takes from Curry's book."""

    azimuth_deg: float = 0.0  # theta_r, of the unscanned beam
    elevation_deg: float = 20.0  # phi_r
    peak_power: float = 2.5e3  # W
    pulse: float = 50e-6  # s
    transmit_gain_db: float = 39.5
    receive_gain_db: float = 39.5
    frequency: float = 3.3e9  # Hz
    temperature: float = 500.0  # K, of the system
    monopulse_slope: float = 1.6  # k_M
    beamwidth_azimuth_deg: float = 2.0
    beamwidth_elevation_deg: float = 2.0
    jammer_bandwidth: float = 0.15e9  # Hz
    pulses: int = 10
    scan_max_deg: float = 60.0  # each way in both angles
    transmit_loss_db: float = 1.5
    receive_loss_db: float = 1.5
    processing_loss_db: float = 1.0
    integration_loss_db: float = 1.0
    beamshape_loss_db: float = 3.2
    jammer_power: float = 15.0  # W effective radiated, at the target
    # the rest is not in the paper
    gas_db_km: float = 0.0075  # one way at sea level, 3 GHz
    gas_height: float = 5e3  # m, scale height of the attenuation
    rain_k: float = 1.26e-4  # ITU-R P.838-3, horizontal, at 3.3 GHz: dB/km one way = k (mm/h)^a
    rain_a: float = 1.34
    detection_db: float = 0.0  # weakest integrated signal that is detected


class Measurements(NamedTuple):
    """Measurements of a target at N times. `y` is NaN where nothing is detected."""

    y: Array  # (N, 3): range m, azimuth rad, elevation rad
    sigma: Array  # (N, 3), standard deviations that the radar reports
    snr_db: Array  # (N,), integrated
    detected: Flags  # (N,)


class RadarConditions(NamedTuple):
    """Rain everywhere, and intervals [from, to), s, of jamming and no signal."""

    rain_mm_h: float = 0.0
    jammed: Sequence[tuple[float, float]] = ()
    lost: Sequence[tuple[float, float]] = ()


def measure(
    radar: Radar,
    t: Array,
    r_RT: Array,
    rng: np.random.Generator,
    conditions: RadarConditions = RadarConditions(),  # noqa: B008 - immutable
) -> Measurements:
    """Measure a target at r_RT (N, 3), east, north, up of the radar (m), at times t (N,), s.

    Each measurement draws three normal numbers, detected or not, so that a fault changes the noise during it only.
    """
    jammed = within(t, conditions.jammed)
    truth = spherical(r_RT)
    ratio = integrated(radar, signal_to_noise(radar, truth, r_RT[:, 2], conditions.rain_mm_h, jammed))
    sigma = accuracy(radar, truth, ratio)
    y = truth + sigma * rng.standard_normal(truth.shape)
    y[:, 1] = np.remainder(y[:, 1] + np.pi, 2 * np.pi) - np.pi
    snr_db = 10 * np.log10(ratio)
    detected = ~within(t, conditions.lost) & in_scan(radar, truth) & (snr_db >= radar.detection_db)
    y[~detected] = np.nan
    return Measurements(y, sigma, snr_db, detected)


def spherical(r_RT: Array) -> Array:
    """Range (m), azimuth and elevation (rad), (N, 3), of points (N, 3), east, north, up."""
    x, y, z = r_RT[:, 0], r_RT[:, 1], r_RT[:, 2]
    level = np.hypot(x, y)
    return np.column_stack([np.hypot(level, z), np.arctan2(x, y), np.arctan2(z, level)])


def bandwidth(radar: Radar) -> float:
    """Bandwidth of the signal, Hz: that of the array at its largest scan angle (0.15 GHz)."""
    widest = np.radians(max(radar.beamwidth_azimuth_deg, radar.beamwidth_elevation_deg))
    return float(widest * SPEED_OF_LIGHT / (0.886 * _wavelength(radar) * np.sin(np.radians(radar.scan_max_deg))))


def scan_angles(radar: Radar, polar: Array) -> Array:
    """Return azimuth and elevation (N, 2), rad, of targets relative to the unscanned beam."""
    azimuth = polar[:, 1] - np.radians(radar.azimuth_deg)
    azimuth = np.remainder(azimuth + np.pi, 2 * np.pi) - np.pi
    return np.column_stack([azimuth, polar[:, 2] - np.radians(radar.elevation_deg)])


def in_scan(radar: Radar, polar: Array) -> Flags:
    """Return (N,) whether the beam can be steered to targets at `polar` (N, 3)."""
    return np.asarray(np.all(np.abs(scan_angles(radar, polar)) <= np.radians(radar.scan_max_deg), axis=1))


def elevation_above_horizon(distance: Array, height: Array) -> Array:
    """Return phi (N,), rad, of targets at a distance and height (m), by the 4/3 Earth."""
    near = np.maximum(distance, 1.0)
    above = ((EFFECTIVE_EARTH_RADIUS + height) ** 2 - near**2 - EFFECTIVE_EARTH_RADIUS**2) / (
        2 * near * EFFECTIVE_EARTH_RADIUS
    )
    return np.asarray(np.arcsin(np.clip(above, -1.0, 1.0)))


def losses_db(radar: Radar, polar: Array, height: Array, rain_mm_h: float = 0.0) -> Array:
    """Return L (N,), dB, over both ways.

    It holds the losses of antennas, processing, beam shape, scan, atmospheric gases and rain. The lens loss, of
    rays that leave the atmosphere, is negligible at the ranges of sense and avoid.
    """
    fixed = radar.transmit_loss_db + radar.receive_loss_db + radar.processing_loss_db + radar.beamshape_loss_db
    off = scan_angles(radar, polar)
    off[:, 1] = elevation_above_horizon(polar[:, 0], height) - np.radians(radar.elevation_deg)
    # beyond 90 degrees there is no beam; `in_scan` applies the scan limit
    scan = -25.0 * np.log10(np.maximum(np.cos(off[:, 0]) * np.cos(off[:, 1]), 1e-3))
    thin = np.maximum(height, 1.0) / radar.gas_height
    gas = radar.gas_db_km * -np.expm1(-thin) / thin  # mean over the path
    rain = radar.rain_k * rain_mm_h**radar.rain_a
    return np.asarray(fixed + scan + 2e-3 * polar[:, 0] * (gas + rain))


def signal_to_noise(
    radar: Radar,
    polar: Array,
    height: Array,
    rain_mm_h: float,
    jammed: Flags,
    cross_section: float = 10**0.01,  # 0.1 dBsm
) -> Array:
    """S/N (N,) of one pulse (eq 46), or S/(J+N) where the target jams, as ratios."""
    wavelength, r = _wavelength(radar), np.maximum(polar[:, 0], 1.0)  # below 1 m there is no far field
    both = _ratio(radar.transmit_gain_db) * _ratio(radar.receive_gain_db)
    energy = radar.peak_power * radar.pulse * both * wavelength**2 * cross_section / ((4 * np.pi) ** 3 * r**4)
    energy = energy / 10 ** (losses_db(radar, polar, height, rain_mm_h) / 10)
    noise = BOLTZMANN_CONSTANT * radar.temperature
    radiated = radar.jammer_power * _ratio(radar.receive_gain_db) * wavelength**2
    jammer = radiated / ((4 * np.pi * r) ** 2 * radar.jammer_bandwidth * _ratio(radar.receive_loss_db))
    return np.asarray(energy / (noise + np.where(jammed, jammer, 0.0)))


def integrated(radar: Radar, ratio: Array) -> Array:
    """S/N (N,) after non-coherent integration of all pulses."""
    return np.asarray(radar.pulses * ratio * ratio / ((1 + ratio) * _ratio(radar.integration_loss_db)))


def accuracy(radar: Radar, polar: Array, ratio: Array) -> Array:
    """Return the standard deviations (N, 3) of range (m), azimuth and elevation (rad), eq 45."""
    cell = SPEED_OF_LIGHT / (2 * bandwidth(radar))
    beam = np.radians([radar.beamwidth_azimuth_deg, radar.beamwidth_elevation_deg])
    beam = beam / np.maximum(np.cos(scan_angles(radar, polar)), 1e-3)
    noisy = np.sqrt(2 * ratio)
    distance = cell * np.hypot(1 / noisy, 1 / 25)
    angles = beam * np.hypot(1 / (radar.monopulse_slope * noisy), 1 / 40)[:, None]
    return np.column_stack([distance, angles])


def _wavelength(radar: Radar) -> float:
    return SPEED_OF_LIGHT / radar.frequency


def _ratio(db: float) -> float:
    return float(10 ** (db / 10))

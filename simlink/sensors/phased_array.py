"""A phased-array radar: what it measures and how well, from the signal-to-noise ratio. De Vivo et al., 5.1.2.

Frame: east, north, up at the radar. Azimuth is clockwise from north, elevation positive up, rad; range in m.

Errata: the paper's S/(J+N) lacks the pulse duration tau (without it watts are divided by joules); the formula it
calls coherent integration is the non-coherent one; L is given "in dB" and enters as a ratio. Its theta is the
azimuth in the vector of measurements and the elevation in the scan loss: here the beam at rest points to azimuth
theta_r and elevation phi_r of Table 4. Where the paper refers to Curry (2005) for a loss, it is said below.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

LIGHT = 299792458.0  # m/s
BOLTZMANN = 1.380649e-23  # J/K
EARTH = 6371e3 * 4 / 3  # m: radio rays bend as if the Earth were larger


class Radar(NamedTuple):
    """Table 4, and what the paper takes from Curry's book."""

    azimuth_deg: float = 0.0  # theta_r, of the beam without scan
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
    # not in the paper
    gas_db_km: float = 0.0075  # one way at sea level, 3 GHz
    gas_height: float = 5e3  # m: the gas thins out by 1/e
    rain_k: float = 1.26e-4  # ITU-R P.838-3, horizontal, at 3.3 GHz: dB/km one way = k (mm/h)^a
    rain_a: float = 1.34
    detection_db: float = 0.0  # an integrated signal weaker than this is not seen


class Look(NamedTuple):
    """What the radar says of a target at each of N times. `y` is NaN where it sees nothing."""

    y: Array  # (N, 3): range m, azimuth rad, elevation rad
    sigma: Array  # (N, 3), what the radar says of its own errors
    snr_db: Array  # (N,), integrated
    seen: npt.NDArray[np.bool_]  # (N,)


class Conditions(NamedTuple):
    """Weather and faults: rain everywhere, and intervals [from, to) s in which the target jams or the signal is
    lost."""

    rain_mm_h: float = 0.0
    jammed: Sequence[tuple[float, float]] = ()
    lost: Sequence[tuple[float, float]] = ()


def look(
    radar: Radar,
    t: Array,
    r_RT: Array,
    rng: np.random.Generator,
    conditions: Conditions = Conditions(),  # noqa: B008 - immutable
) -> Look:
    """The radar on a target at r_RT (N, 3), east, north, up from it, at times t (N,).

    Every look takes three normal numbers, seen or not, so that faults do not change the noise elsewhere.
    """
    jammed = _within(t, conditions.jammed)
    truth = spherical(r_RT)
    ratio = integrated(radar, signal_to_noise(radar, truth, r_RT[:, 2], conditions.rain_mm_h, jammed))
    sigma = accuracy(radar, truth, ratio)
    y = truth + sigma * rng.standard_normal(truth.shape)
    y[:, 1] = np.remainder(y[:, 1] + np.pi, 2 * np.pi) - np.pi
    snr_db = 10 * np.log10(ratio)
    seen = ~_within(t, conditions.lost) & in_scan(radar, truth) & (snr_db >= radar.detection_db)
    y[~seen] = np.nan
    return Look(y, sigma, snr_db, seen)


def spherical(r_RT: Array) -> Array:
    """Range, azimuth and elevation (N, 3) of points (N, 3)."""
    x, y, z = r_RT[:, 0], r_RT[:, 1], r_RT[:, 2]
    level = np.hypot(x, y)
    return np.column_stack([np.hypot(level, z), np.arctan2(x, y), np.arctan2(z, level)])


def bandwidth(radar: Radar) -> float:
    """Of the signal, Hz: what the array passes at its largest scan (.15 GHz)."""
    widest = np.radians(max(radar.beamwidth_azimuth_deg, radar.beamwidth_elevation_deg))
    return float(widest * LIGHT / (0.886 * _wavelength(radar) * np.sin(np.radians(radar.scan_max_deg))))


def scan_angles(radar: Radar, seen: Array) -> Array:
    """Angles off the beam at rest (N, 2), rad: in azimuth and elevation."""
    azimuth = seen[:, 1] - np.radians(radar.azimuth_deg)
    azimuth = np.remainder(azimuth + np.pi, 2 * np.pi) - np.pi
    return np.column_stack([azimuth, seen[:, 2] - np.radians(radar.elevation_deg)])


def in_scan(radar: Radar, seen: Array) -> npt.NDArray[np.bool_]:
    """Whether the beam can be steered there (N,)."""
    return np.asarray(np.all(np.abs(scan_angles(radar, seen)) <= np.radians(radar.scan_max_deg), axis=1))


def elevation_above_horizon(distance: Array, height: Array) -> Array:
    """Phi (N,), rad, of targets at a range and height, m, over an Earth of 4/3 the radius."""
    near = np.maximum(distance, 1.0)
    above = ((EARTH + height) ** 2 - near**2 - EARTH**2) / (2 * near * EARTH)
    return np.asarray(np.arcsin(np.clip(above, -1.0, 1.0)))


def losses_db(radar: Radar, seen: Array, height: Array, rain_mm_h: float = 0.0) -> Array:
    """L (N,): antennas, processing, beam shape, scan, gases (path loss) and rain, there and back.

    The lens loss, of rays that leave the atmosphere, is nothing at the ranges of sense and avoid.
    """
    fixed = radar.transmit_loss_db + radar.receive_loss_db + radar.processing_loss_db + radar.beamshape_loss_db
    off = scan_angles(radar, seen)
    off[:, 1] = elevation_above_horizon(seen[:, 0], height) - np.radians(radar.elevation_deg)
    # beyond 90 degrees there is no beam; the scan's limit is kept elsewhere
    scan = -25.0 * np.log10(np.maximum(np.cos(off[:, 0]) * np.cos(off[:, 1]), 1e-3))
    thin = np.maximum(height, 1.0) / radar.gas_height
    gas = radar.gas_db_km * -np.expm1(-thin) / thin  # mean over the path
    rain = radar.rain_k * rain_mm_h**radar.rain_a
    return np.asarray(fixed + scan + 2e-3 * seen[:, 0] * (gas + rain))


def signal_to_noise(
    radar: Radar,
    seen: Array,
    height: Array,
    rain_mm_h: float,
    jammed: npt.NDArray[np.bool_],
    cross_section: float = 10**0.01,  # 0.1 dBsm
) -> Array:
    """S/N (N,) of one pulse (eq 46), or S/(J+N) where the target jams, as ratios."""
    wavelength, r = _wavelength(radar), np.maximum(seen[:, 0], 1.0)  # nearer is the far field of no radar
    both = _ratio(radar.transmit_gain_db) * _ratio(radar.receive_gain_db)
    energy = radar.peak_power * radar.pulse * both * wavelength**2 * cross_section / ((4 * np.pi) ** 3 * r**4)
    energy = energy / 10 ** (losses_db(radar, seen, height, rain_mm_h) / 10)
    noise = BOLTZMANN * radar.temperature
    radiated = radar.jammer_power * _ratio(radar.receive_gain_db) * wavelength**2
    jammer = radiated / ((4 * np.pi * r) ** 2 * radar.jammer_bandwidth * _ratio(radar.receive_loss_db))
    return np.asarray(energy / (noise + np.where(jammed, jammer, 0.0)))


def integrated(radar: Radar, ratio: Array) -> Array:
    """S/N of all pulses, added up without their phases."""
    return np.asarray(radar.pulses * ratio * ratio / ((1 + ratio) * _ratio(radar.integration_loss_db)))


def accuracy(radar: Radar, seen: Array, ratio: Array) -> Array:
    """Standard deviations (N, 3) of range (m), azimuth and elevation (rad): eq 45, noise and fixed errors."""
    cell = LIGHT / (2 * bandwidth(radar))
    beam = np.radians([radar.beamwidth_azimuth_deg, radar.beamwidth_elevation_deg])
    beam = beam / np.maximum(np.cos(scan_angles(radar, seen)), 1e-3)
    noisy = np.sqrt(2 * ratio)
    distance = cell * np.hypot(1 / noisy, 1 / 25)
    angles = beam * np.hypot(1 / (radar.monopulse_slope * noisy), 1 / 40)[:, None]
    return np.column_stack([distance, angles])


def _wavelength(radar: Radar) -> float:
    return LIGHT / radar.frequency


def _ratio(db: float) -> float:
    return float(10 ** (db / 10))


def _within(t: Array, intervals: Sequence[tuple[float, float]]) -> npt.NDArray[np.bool_]:
    inside = np.zeros(t.shape, bool)
    for begin, end in intervals:
        inside |= (t >= begin) & (t < end)
    return inside

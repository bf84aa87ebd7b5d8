"""WGS-84 coordinates, ECEF, and local NED frames."""

import numpy as np
from numpy.typing import ArrayLike

from onboard.arrays import Array

WGS84_A = 6378137.0  # m
WGS84_F = 1 / 298.257223563
WGS84_E2 = WGS84_F * (2 - WGS84_F)


def ecef_from_geodetic(lat_deg: float, lon_deg: float, height: float) -> Array:
    """Return the position (3,) in e, m, of WGS-84 degrees and metres above the ellipsoid."""
    lat, lon = np.radians([lat_deg, lon_deg])
    n = WGS84_A / np.sqrt(1 - WGS84_E2 * np.sin(lat) ** 2)
    return np.array(
        [
            (n + height) * np.cos(lat) * np.cos(lon),
            (n + height) * np.cos(lat) * np.sin(lon),
            (n * (1 - WGS84_E2) + height) * np.sin(lat),
        ]
    )


def geodetic_from_ecef(r_e: ArrayLike) -> tuple[float, float, float]:
    """Return (lat_deg, lon_deg, height m) of r_e (3,).

    Bowring's start and three Newton-like sweeps are exact to nanometres from the Earth's surface to orbit. At the
    poles the longitude is 0 by convention.
    """
    x, y, z = np.asarray(r_e, dtype=float)
    p = float(np.hypot(x, y))
    b = WGS84_A * (1 - WGS84_F)
    theta = np.arctan2(z * WGS84_A, p * b)
    for _ in range(3):
        lat = np.arctan2(
            z + WGS84_E2 / (1 - WGS84_F) ** 2 * b * np.sin(theta) ** 3, p - WGS84_E2 * WGS84_A * np.cos(theta) ** 3
        )
        theta = np.arctan2((1 - WGS84_F) * np.sin(lat), np.cos(lat))
    n = WGS84_A / np.sqrt(1 - WGS84_E2 * np.sin(lat) ** 2)
    # Of two formulas for the height, use the one whose divisor does not vanish here.
    height = p / np.cos(lat) - n if abs(lat) < np.pi / 4 else z / np.sin(lat) - n * (1 - WGS84_E2)
    return float(np.degrees(lat)), float(np.degrees(np.arctan2(y, x))), float(height)


def geodetic_rows(r_e: Array) -> Array:
    """Return (lat_deg, lon_deg, height m), (k, 3), of r_e (k, 3), as `geodetic_from_ecef`."""
    x, y, z = r_e.T
    p = np.hypot(x, y)
    b = WGS84_A * (1 - WGS84_F)
    theta = np.arctan2(z * WGS84_A, p * b)
    for _ in range(3):
        lat = np.arctan2(
            z + WGS84_E2 / (1 - WGS84_F) ** 2 * b * np.sin(theta) ** 3, p - WGS84_E2 * WGS84_A * np.cos(theta) ** 3
        )
        theta = np.arctan2((1 - WGS84_F) * np.sin(lat), np.cos(lat))
    sine, cosine = np.sin(lat), np.cos(lat)
    n = WGS84_A / np.sqrt(1 - WGS84_E2 * sine**2)
    low = np.abs(lat) < np.pi / 4
    height = np.where(low, p / np.where(low, cosine, 1) - n, z / np.where(low, 1, sine) - n * (1 - WGS84_E2))
    return np.stack([np.degrees(lat), np.degrees(np.arctan2(y, x)), height], axis=1)


def rotation_ne(lat_deg: float, lon_deg: float) -> Array:
    """Return R_ne (3, 3) from components in e to NED at that latitude and longitude."""
    lat, lon = np.radians([lat_deg, lon_deg])
    sl, cl, so, co = np.sin(lat), np.cos(lat), np.sin(lon), np.cos(lon)
    return np.array([[-sl * co, -sl * so, cl], [-so, co, 0.0], [-cl * co, -cl * so, -sl]])


def ned_from_geodetic(geodetic: tuple[float, float, float], origin: tuple[float, float, float]) -> Array:
    """Return r_OP_n (3,), m, of a point from an origin, both (lat_deg, lon_deg, height)."""
    difference = ecef_from_geodetic(*geodetic) - ecef_from_geodetic(*origin)
    return np.asarray(rotation_ne(origin[0], origin[1]) @ difference)


def geodetic_from_ned(r_OP_n: ArrayLike, origin: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return (lat_deg, lon_deg, height) of a point at r_OP_n (3,), m, from an origin.

    The origin has the same form.
    """
    r_e = ecef_from_geodetic(*origin) + rotation_ne(origin[0], origin[1]).T @ np.asarray(r_OP_n, dtype=float)
    return geodetic_from_ecef(r_e)

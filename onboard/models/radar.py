"""Echoes at a radar at the origin of a local frame: range, azimuth, elevation. De Vivo et al. eqs 35-37.

The frame is east, north, up at the radar; rows begin like those of `constant_acceleration`. Azimuth is clockwise
from north (y), elevation positive up. Erratum: eq 36 prints arctan(x / y), which folds; it is atan2(x, y).
"""

from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.compiled import FILLING, MAKING, kernel, signature
from onboard.geometry.arctangent import arctan2

MEASUREMENT_SIZE: Final = 3
ANGULAR: Final = (1, 2)


def measure(rows: Array) -> Array:
    """Return range (m), azimuth and elevation (rad), (k, 3), of state rows (k, 9 or more)."""
    polar = np.empty((MEASUREMENT_SIZE, len(rows)))  # faster than an array from machine code
    _measure(rows, polar)
    return polar.T


def jacobian(rows: Array) -> Array:
    """Return the derivatives (k, 3, n) of `measure`: eq 37. Infinite or NaN straight above the radar."""
    slope: Array = _jacobian(rows)
    return slope


def cartesian(polar: Array) -> Array:
    """Return positions (..., 3), east, north, up, of measurements (..., 3)."""
    r, azimuth, elevation = polar[..., 0], polar[..., 1], polar[..., 2]
    level = r * np.cos(elevation)
    return np.stack([level * np.sin(azimuth), level * np.cos(azimuth), r * np.sin(elevation)], axis=-1)


@kernel(**FILLING)
def _to_polar(first, second, third):
    """Replace x, y and z by range, azimuth and elevation."""
    for s in range(first.shape[0]):
        x, y, z = first[s], second[s], third[s]
        level2 = x * x + y * y
        first[s] = np.sqrt(level2 + z * z)
        second[s] = arctan2(x, y)
        third[s] = arctan2(z, np.sqrt(level2))


@kernel(signature(2, "out"), **FILLING)
def _measure(rows, polar):
    """Process one component at a time, so that roots and arctangents of several rows become one instruction."""
    for i in range(3):
        for s in range(rows.shape[0]):
            polar[i, s] = rows[s, 3 * i]
    _to_polar(polar[0], polar[1], polar[2])


@kernel(signature(2), **MAKING)
def _jacobian(rows):
    slope = np.zeros((rows.shape[0], 3, rows.shape[1]))
    for s in range(rows.shape[0]):
        x, y, z = rows[s, 0], rows[s, 3], rows[s, 6]
        level2 = x * x + y * y
        level, r2 = np.sqrt(level2), level2 + z * z
        r = np.sqrt(r2)
        slope[s, 0, 0], slope[s, 0, 3], slope[s, 0, 6] = x / r, y / r, z / r
        slope[s, 1, 0], slope[s, 1, 3] = y / level2, -x / level2
        slope[s, 2, 0], slope[s, 2, 3] = -x * z / (level * r2), -y * z / (level * r2)
        slope[s, 2, 6] = level / r2
    return slope

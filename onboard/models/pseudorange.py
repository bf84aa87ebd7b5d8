"""Pseudoranges and pseudorange rates of a GNSS receiver. De Vivo et al. eqs 50-51, appendix B.

State rows as in `gnss_clock`, in e. Satellites are given as the receiver computes them from the broadcast orbits:
positions and velocities in e at the time of reception, Sagnac effect and satellite clocks removed.

Errata: with d = xi_s - xi, appendix B's derivative of the rate by the position is -d_dot / R + R_dot d / R^2; it
prints -d / R + R_dot d / R^2 (for R_dot as in eq 51). Its columns for velocities and accelerations are those of a
measurement dt after the state, and the sign inside the last one must be minus.
"""

from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.compiled import MAKING, ROWS, kernel

SIGNATURE: Final = (ROWS, ROWS, ROWS)


def measure(rows: Array, position: Array, velocity: Array) -> Array:
    """Return pseudoranges, m, then rates, m/s, (k, 2 s), of state rows (k, 11) and satellites (s, 3) in e."""
    ranges: Array = _measure(rows, position, velocity)
    return ranges


def jacobian(rows: Array, position: Array, velocity: Array) -> Array:
    """Return the derivatives (k, 2 s, 11) of `measure`."""
    slope: Array = _jacobian(rows, position, velocity)
    return slope


@kernel(SIGNATURE, **MAKING)
def _measure(rows, position, velocity):
    count = position.shape[0]
    ranges = np.empty((rows.shape[0], 2 * count))
    for s in range(rows.shape[0]):
        for k in range(count):
            r, rate = _range_and_rate(rows[s], position[k], velocity[k])
            ranges[s, k] = r + rows[s, 9]
            ranges[s, count + k] = rate + rows[s, 10]
    return ranges


@kernel(SIGNATURE, **MAKING)
def _jacobian(rows, position, velocity):
    count = position.shape[0]
    slope = np.zeros((rows.shape[0], 2 * count, rows.shape[1]))
    for s in range(rows.shape[0]):
        for k in range(count):
            r, rate = _range_and_rate(rows[s], position[k], velocity[k])
            for i in range(3):
                d = position[k, i] - rows[s, 3 * i]
                d_dot = velocity[k, i] - rows[s, 3 * i + 1]
                slope[s, k, 3 * i] = -d / r
                slope[s, count + k, 3 * i] = (rate * d / r - d_dot) / r
                slope[s, count + k, 3 * i + 1] = -d / r
            slope[s, k, 9] = 1.0
            slope[s, count + k, 10] = 1.0
    return slope


@kernel(**MAKING)
def _range_and_rate(row, position, velocity):
    r2 = closing = 0.0
    for i in range(3):
        d = position[i] - row[3 * i]
        r2 += d * d
        closing += d * (velocity[i] - row[3 * i + 1])
    r = np.sqrt(r2)
    return r, closing / r

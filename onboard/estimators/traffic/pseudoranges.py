"""Position and velocity of another vehicle from its own pseudoranges, epoch by epoch.

Error and drift of its clock are estimated and discarded: no motion depends on them.
"""

from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters.gating import chi_square_threshold
from onboard.messages import SatelliteRange
from onboard.models import gnss_clock, pseudorange

GAUSS_NEWTON_ITERATIONS: Final = 6  # Three are enough from 10 km away.
PRIOR_SIGMA: Final = np.array([1e4, 1e3, 1e3, 1e7, 1e5])  # m, m/s, m/s^2; clock error m, drift m/s
RESIDUAL_TEST_PROBABILITY: Final = 0.9999  # that satellites without a fault pass the test of their residuals


class Fix(NamedTuple):
    """Position and velocity in e, (6,), and their covariance (6, 6).

    Attributes
    ----------
    agree
        Whether the satellites' residuals are consistent with their noise.
    """

    y: Array
    R: Array
    agree: bool


def solve(satellites: tuple[SatelliteRange, ...], near: Array, sigma: float, rate_sigma: float) -> Fix:
    """Return the fix of pseudoranges and their rates, by least squares.

    `near` (3,) is a position in e within some 10 km. `sigma` and `rate_sigma` are for satellites without a
    standard deviation. With fewer than four satellites, the undetermined directions keep the prior's 10 km, as the
    covariance shows.
    """
    position = np.array([s.r_e for s in satellites])
    velocity = np.array([s.v_e for s in satellites])
    y = np.array([s.pseudorange for s in satellites] + [s.rate for s in satellites])
    noise = [s.sigma or sigma for s in satellites] + [s.rate_sigma or rate_sigma for s in satellites]
    H_scale = 1.0 / np.array(noise)
    prior = np.zeros(gnss_clock.STATE_SIZE)
    prior[list(gnss_clock.POSITION)] = near
    wide = np.empty(gnss_clock.STATE_SIZE)
    parts = (gnss_clock.POSITION, gnss_clock.VELOCITY, gnss_clock.ACCELERATION, (9,), (10,))
    for part, size in zip(parts, PRIOR_SIGMA, strict=True):
        wide[list(part)] = size
    x = prior.copy()
    for _ in range(GAUSS_NEWTON_ITERATIONS):
        H = pseudorange.jacobian(x[None], position, velocity)[0] * H_scale[:, None] * wide
        e = (y - pseudorange.measure(x[None], position, velocity)[0]) * H_scale
        step = np.linalg.solve(H.T @ H + np.eye(gnss_clock.STATE_SIZE), H.T @ e - (x - prior) / wide)
        x = x + wide * step
    covariance = np.linalg.inv(H.T @ H + np.eye(gnss_clock.STATE_SIZE)) * np.outer(wide, wide)
    e = (y - pseudorange.measure(x[None], position, velocity)[0]) * H_scale
    spare = len(y) - 8
    agree = spare <= 0 or float(e @ e) <= chi_square_threshold(RESIDUAL_TEST_PROBABILITY, spare)
    kept = [*gnss_clock.POSITION, *gnss_clock.VELOCITY]
    return Fix(x[kept], covariance[np.ix_(kept, kept)], agree)

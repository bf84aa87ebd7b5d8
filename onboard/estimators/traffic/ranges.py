"""Where another vehicle is by its own pseudoranges: position and velocity of one epoch, its clock's error and
drift found with them and dropped, for they are nobody's motion."""

from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters.gating import chi_square_threshold
from onboard.messages import SatelliteRange
from onboard.models import gnss_clock, pseudorange

STEPS: Final = 6  # of Gauss and Newton; from 10 km away three are enough
WIDE: Final = np.array([1e4, 1e3, 1e3, 1e7, 1e5])  # m, m/s, m/s^2, clock m and m/s: what is known beforehand
UNLIKELY: Final = 0.9999  # of what satellites that agree differ by


class Fix(NamedTuple):
    """Position and velocity in e, (6,), and their covariance (6, 6); `agree`: whether the satellites do."""

    y: Array
    R: Array
    agree: bool


def solve(satellites: tuple[SatelliteRange, ...], near: Array, sigma: float, rate_sigma: float) -> Fix:
    """The fix of pseudoranges and their rates, by least squares about `near` (3,), a place in e within some 10 km.

    Standard deviations are those of satellites that bring none. Of fewer than four satellites the covariance says
    which directions they leave open: there it has the 10 km that were granted beforehand.
    """
    position = np.array([s.r_e for s in satellites])
    velocity = np.array([s.v_e for s in satellites])
    y = np.array([s.pseudorange for s in satellites] + [s.rate for s in satellites])
    noise = [s.sigma or sigma for s in satellites] + [s.rate_sigma or rate_sigma for s in satellites]
    H_scale = 1.0 / np.array(noise)
    prior = np.zeros(gnss_clock.N)
    prior[list(gnss_clock.POSITION)] = near
    wide = np.empty(gnss_clock.N)
    parts = (gnss_clock.POSITION, gnss_clock.VELOCITY, gnss_clock.ACCELERATION, (9,), (10,))
    for part, size in zip(parts, WIDE, strict=True):
        wide[list(part)] = size
    x = prior.copy()
    for _ in range(STEPS):
        H = pseudorange.jacobian(x[None], position, velocity)[0] * H_scale[:, None] * wide
        e = (y - pseudorange.measure(x[None], position, velocity)[0]) * H_scale
        step = np.linalg.solve(H.T @ H + np.eye(gnss_clock.N), H.T @ e - (x - prior) / wide)
        x = x + wide * step
    covariance = np.linalg.inv(H.T @ H + np.eye(gnss_clock.N)) * np.outer(wide, wide)
    e = (y - pseudorange.measure(x[None], position, velocity)[0]) * H_scale
    spare = len(y) - 8
    agree = spare <= 0 or float(e @ e) <= chi_square_threshold(UNLIKELY, spare)
    places = [*gnss_clock.POSITION, *gnss_clock.VELOCITY]
    return Fix(x[places], covariance[np.ix_(places, places)], agree)

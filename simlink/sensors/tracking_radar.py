"""A launch site's tracking radar with white noise. Varaprasad et al., section 4.

It measures range, azimuth and elevation. The frame is east, north, up at the radar (the paper's topocentric
triad). Azimuth is clockwise from north, rad.
"""

from typing import NamedTuple

import numpy as np

from simlink.sensors.arrays import Array
from simlink.sensors.phased_array import spherical


class TrackingRadar(NamedTuple):
    """The 1-sigma errors; the paper also uses three times as much."""

    range_sigma: float = 10.0  # m
    azimuth_sigma: float = 0.2e-3  # rad
    elevation_sigma: float = 0.2e-3  # rad

    def times(self, factor: float) -> "TrackingRadar":
        """The same radar with all its noise `factor` times as large."""
        return TrackingRadar(*(factor * sigma for sigma in self))


def track(radar: TrackingRadar, r_RT: Array, rng: np.random.Generator) -> Array:
    """Return measured range (m), azimuth and elevation (rad), (N, 3), of a target.

    The target is at r_RT (N, 3), east, north, up from the radar.
    """
    y = spherical(r_RT) + np.array(radar) * rng.standard_normal(r_RT.shape)
    y[:, 1] = np.remainder(y[:, 1] + np.pi, 2 * np.pi) - np.pi
    return y

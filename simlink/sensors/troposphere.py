"""The tropospheric delay of a GNSS pseudorange. De Vivo et al. eq 53.

The mapping functions are those of Niell (1996, J. Geophys. Res. 101 B2, tables 3 and 4). Erratum: the paper's
T_dry contains z of its NED frame where the altitude, -z, must stand.
"""

import numpy as np

from simlink.sensors.arrays import Array

DRY_ZENITH_DELAY = 2.3  # m, at sea level
DRY_DECAY = 0.116e-3  # 1/m
WET_ZENITH_DELAY = 0.1  # m
LATITUDES_DEG = (15.0, 30.0, 45.0, 60.0, 75.0)
# a, b, c at those latitudes: yearly mean of the dry part, its seasonal amplitude, and the wet part
DRY_AVERAGE = (
    (1.2769934e-3, 1.2683230e-3, 1.2465397e-3, 1.2196049e-3, 1.2045996e-3),
    (2.9153695e-3, 2.9152299e-3, 2.9288445e-3, 2.9022565e-3, 2.9024912e-3),
    (62.610505e-3, 62.837393e-3, 63.721774e-3, 63.824265e-3, 64.258455e-3),
)
DRY_SEASON = (
    (0.0, 1.2709626e-5, 2.6523662e-5, 3.4000452e-5, 4.1202191e-5),
    (0.0, 2.1414979e-5, 3.0160779e-5, 7.2562722e-5, 11.723375e-5),
    (0.0, 9.0128400e-5, 4.3497037e-5, 84.795348e-5, 170.37206e-5),
)
WET_COEFFICIENTS = (
    (5.8021897e-4, 5.6794847e-4, 5.8118019e-4, 5.9727542e-4, 6.1641693e-4),
    (1.4275268e-3, 1.5138625e-3, 1.4572752e-3, 1.5007428e-3, 1.7599082e-3),
    (4.3472961e-2, 4.6729510e-2, 4.3908931e-2, 4.4626982e-2, 5.4736038e-2),
)
HEIGHT_COEFFICIENTS = (2.53e-5, 5.49e-3, 1.14e-3)
COLDEST_DAY_NUMBER = 28.0  # of the year, in the north
YEAR_LENGTH_DAYS = 365.25


def delay(
    elevation: Array, height: float, lat_deg: float, day: float, wet_zenith: float = WET_ZENITH_DELAY
) -> Array:
    """Return the extra path (s,), m, of rays at `elevation` (s,), rad > 0.

    `height` is in m, `day` is that of the year.
    """
    dry = DRY_ZENITH_DELAY * np.exp(-DRY_DECAY * height)
    return np.asarray(
        dry * dry_mapping(elevation, height, lat_deg, day) + wet_zenith * wet_mapping(elevation, lat_deg)
    )


def dry_mapping(elevation: Array, height: float, lat_deg: float, day: float) -> Array:
    """Ratio of the dry delay to that at the zenith (s,)."""
    winter = COLDEST_DAY_NUMBER if lat_deg >= 0 else COLDEST_DAY_NUMBER + YEAR_LENGTH_DAYS / 2
    season = np.cos(2 * np.pi * (day - winter) / YEAR_LENGTH_DAYS)
    a, b, c = _at(DRY_AVERAGE, lat_deg) - _at(DRY_SEASON, lat_deg) * season
    correction = 1 / np.sin(elevation) - _fraction(elevation, *HEIGHT_COEFFICIENTS)
    return np.asarray(_fraction(elevation, a, b, c) + correction * height / 1e3)


def wet_mapping(elevation: Array, lat_deg: float) -> Array:
    """Ratio of the wet delay to that at the zenith (s,)."""
    return _fraction(elevation, *_at(WET_COEFFICIENTS, lat_deg))


def _at(table: tuple[tuple[float, ...], ...], lat_deg: float) -> Array:
    """The coefficients interpolated at a latitude, constant beyond the table."""
    return np.array([np.interp(abs(lat_deg), LATITUDES_DEG, row) for row in table])


def _fraction(elevation: Array, a: float, b: float, c: float) -> Array:
    """Marini's continued fraction; 1 at the zenith."""
    s = np.sin(elevation)
    return np.asarray((1 + a / (1 + b / (1 + c))) / (s + a / (s + b / (s + c))))

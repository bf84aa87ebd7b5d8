"""Cartesian frame n for reported positions: NED at an anchor, our first known position.

Everything goes through ECEF, so neither a pole nor the antimeridian is special, and the frame stays exact at any
distance from its anchor. Heights above mean sea level are treated as heights above the ellipsoid, for all aircraft
alike: the geoid's slope over a few kilometres is centimetres.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.geometry.geodesy import ecef_from_geodetic, geodetic_rows, rotation_ne
from onboard.messages import Barometer, GlobalPosition
from onboard.ownship import Ownship
from onboard.units import NS_PER_S, S_PER_NS

NO_POSITION: Final = (0.0, 0.0)  # latitude and longitude from a sender without a position
OWN_POSITION_TIMEOUT_NS: Final = 3 * NS_PER_S
SAME_VELOCITY_M_S: Final = 2.0  # several times what a transponder rounds


class OwnMotion(NamedTuple):
    """Our own motion in n.

    Attributes
    ----------
    r, v
        Position and velocity (3,).
    R_nb
        Attitude (3, 3), from body.
    R_nl
        Rotation (3, 3) from l, NED where we are.
    """

    r: Array
    v: Array
    R_nb: Array
    R_nl: Array


class Frame:
    """The frame n and our newest position and velocity in it. None is known before our first position.
    `pressure_altitude_offset`: height above mean sea level less pressure altitude, m, by our own barometer; None
    without one."""

    def __init__(self) -> None:
        self._anchor_e = np.zeros(3)
        self._R_ne: Array | None = None
        self._newest: tuple[int, Array, Array] | None = None  # time, r, R_nl
        self._velocity, self._height = np.zeros(3), math.nan
        self.pressure_altitude_offset: float | None = None

    @property
    def known(self) -> bool:
        """Whether there is an anchor."""
        return self._R_ne is not None

    def receive(self, m: GlobalPosition) -> None:
        """Receive our own position; (0, 0) is ignored, since it means none."""
        if (m.lat_deg, m.lon_deg) == NO_POSITION or not on_earth(m.lat_deg, m.lon_deg):
            return
        if self._R_ne is None:
            self._anchor_e = ecef_from_geodetic(m.lat_deg, m.lon_deg, m.alt_msl)
            self._R_ne = rotation_ne(m.lat_deg, m.lon_deg)
        if self._newest is None or m.t_ns > self._newest[0]:
            r = self.position(m.lat_deg, m.lon_deg, m.alt_msl)
            self._newest = m.t_ns, r, self.rotation_nl(m.lat_deg, m.lon_deg)
            self._velocity, self._height = self._newest[2] @ m.v_F_n, m.alt_msl

    def receive_pressure(self, m: Barometer) -> None:
        """Our own pressure altitude, beside our newest height."""
        if self._newest is not None and abs(m.t_ns - self._newest[0]) <= OWN_POSITION_TIMEOUT_NS:
            self.pressure_altitude_offset = self._height - m.pressure_altitude

    def is_here(self, t_ns: int, y: Array, sigma: float) -> bool:
        """Whether somebody with this position and velocity (6,) at a time is where we are, and flies as we do:
        within two standard deviations horizontally, m."""
        if self._newest is None or abs(t_ns - self._newest[0]) > OWN_POSITION_TIMEOUT_NS:
            return False
        t0_ns, r, R_nl = self._newest
        off = (y[:3] - r - self._velocity * ((t_ns - t0_ns) * S_PER_NS)) @ R_nl
        slower = np.linalg.norm((y[3:] - self._velocity) @ R_nl[:, :2])
        return bool(np.linalg.norm(off[:2]) < 2.0 * sigma and slower < SAME_VELOCITY_M_S)

    def position(self, lat_deg: float, lon_deg: float, height: float) -> Array:
        """Return r_On (3,) of geodetic coordinates. The frame must be known."""
        return np.asarray(self._known_R_ne() @ (ecef_from_geodetic(lat_deg, lon_deg, height) - self._anchor_e))

    def ecef(self, r: Array | None) -> Array | None:
        """Return the ECEF position of r (3,) in n, or of our newest position for None.

        None if we have none.
        """
        if self._newest is None:
            return None
        return np.asarray(self._anchor_e + (self._newest[1] if r is None else r) @ self._known_R_ne())

    def from_ecef(self, y: Array, R: Array) -> tuple[Array, Array]:
        """Return position and velocity (6,) in n, and their covariance (6, 6), of those in e."""
        both = np.kron(np.eye(2), self._known_R_ne())
        return both @ np.concatenate([y[:3] - self._anchor_e, y[3:]]), both @ R @ both.T

    def rotation_nl(self, lat_deg: float, lon_deg: float) -> Array:
        """Return R_nl (3, 3) from NED at a place to n. The frame must be known."""
        return np.asarray(self._known_R_ne() @ rotation_ne(lat_deg, lon_deg).T)

    def geodetic(self, r: Array) -> Array:
        """Return (lat_deg, lon_deg, height), (k, 3), of positions r (k, 3).

        The frame must be known.
        """
        return geodetic_rows(self._anchor_e + r @ self._known_R_ne())

    def own_motion(self, t_ns: int, ownship: Ownship) -> OwnMotion | None:
        """Return our motion at a time: the newest position, moved by our mean velocity since then.

        None if the position is unknown or too old, or if the pose is unknown.
        """
        if self._newest is None or abs(t_ns - self._newest[0]) > OWN_POSITION_TIMEOUT_NS:
            return None
        t0_ns, r, R_nl = self._newest
        pose, then = ownship.pose_at(t_ns), ownship.pose_at(t0_ns)
        if pose is None:
            return None
        v = pose.v_F_n
        mean = v if then is None else 0.5 * (v + then.v_F_n)
        return OwnMotion(r + R_nl @ (mean * ((t_ns - t0_ns) * S_PER_NS)), R_nl @ v, R_nl @ pose.R_nb, R_nl)

    def _known_R_ne(self) -> Array:
        assert self._R_ne is not None  # noqa: S101 - callers have checked that it is known
        return self._R_ne


def on_earth(lat_deg: float, lon_deg: float) -> bool:
    """Return whether these are a latitude and a longitude.

    The last digit on the wire is tolerated.
    """
    return abs(lat_deg) <= 90.0 + 1e-7 and abs(lon_deg) <= 180.0 + 1e-7

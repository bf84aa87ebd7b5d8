"""The GNSS receiver of another aircraft, which shares its pseudoranges and their rates.

Its errors are those of `simlink.sensors.gnss`, its satellites those of a real almanac.
"""

import math
from typing import Final

import numpy as np

from onboard.geometry.geodesy import ecef_from_geodetic, rotation_ne
from onboard.messages import Clock, Pseudoranges, SatelliteRange, Vec3
from simlink.scenarios.profiles import is_within
from simlink.scenarios.traffic import PeerReceiver
from simlink.sensors import almanac, gnss, troposphere
from simlink.world.noise import stream

EPOCH: Final = 61_440.0  # s of the almanac's week at which the flight begins


class RangesSensor:
    """One aircraft's receiver; `origin` is that of the scenario's local frame."""

    def __init__(
        self, receiver: PeerReceiver, system: int, origin: tuple[float, float, float], seed: int, name: str
    ) -> None:
        self._settings, self._system = receiver, system
        self._receiver = gnss.Receiver(sigma=receiver.sigma, rate_sigma=receiver.rate_sigma)
        self._origin_e, self._R_ne = ecef_from_geodetic(*origin), rotation_ne(origin[0], origin[1])
        self._almanac = almanac.load()
        self._rng = stream(seed, f"{name}.ranges")
        self._clock = self._rng.standard_normal(2) * (self._receiver.clock_sigma, self._receiver.drift_sigma)
        self._wet = troposphere.WET_ZENITH_DELAY

    def measure(self, t: float, t_ns: int, r: Vec3, v: Vec3) -> Pseudoranges | None:
        """Return the measurements at flight time t (s), or None without a signal.

        Position r from the origin and velocity v are in n at the origin. Call it once per epoch, since it draws
        random numbers in any case.
        """
        noise = self._rng.standard_normal((2, len(self._almanac.names)))
        self._advance_errors(1.0 / self._settings.rate)
        if is_within(t, self._settings.lost):
            return None
        r_e, v_e = self._origin_e + np.array(r) @ self._R_ne, np.array(v) @ self._R_ne
        satellites = almanac.satellites(self._almanac, EPOCH + t)
        fix = gnss.fix(self._receiver, satellites, r_e, v_e, self._clock, self._wet, noise)
        count = len(fix.slots)
        if is_within(t, self._settings.masked):
            count = min(count, 3)
        # the receiver does not know its clock error, but its stamp is accurate to a microsecond
        return Pseudoranges(
            t_ns=t_ns,
            clock=Clock.BOOT,
            peer=self._system,
            satellites=tuple(self._range(fix, k) for k in range(count)),
        )

    def _range(self, fix: gnss.Fix, k: int) -> SatelliteRange:
        n = len(fix.slots)
        x, y, z = fix.position[k].tolist()
        vx, vy, vz = fix.velocity[k].tolist()
        return SatelliteRange(
            satellite=self._almanac.names[fix.slots[k]],
            r_e=(x, y, z),
            v_e=(vx, vy, vz),
            pseudorange=float(fix.y[k]),
            rate=float(fix.y[n + k]),
            sigma=float(fix.sigma[k]),
            rate_sigma=float(fix.sigma[n + k]),
        )

    def _advance_errors(self, dt: float) -> None:
        """Advance the random walks of clock and troposphere by dt (s)."""
        walk, drift, wet = self._rng.standard_normal(3)
        r = self._receiver
        self._clock[0] += dt * self._clock[1] + math.sqrt(r.clock_walk * dt) * walk
        self._clock[1] += math.sqrt(r.drift_walk * dt) * drift
        self._wet += math.sqrt(r.wet_walk * dt) * wet

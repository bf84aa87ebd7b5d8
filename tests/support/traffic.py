"""A tracker alone: our own vehicle on a straight line, others' reports, and a radar's echoes."""

import math
from collections.abc import Iterable
from typing import Any, Final

import numpy as np

from onboard.arrays import Array
from onboard.estimators.traffic.config import Config
from onboard.estimators.traffic.estimator import Estimator
from onboard.geometry.camera import make_camera
from onboard.geometry.geodesy import ecef_from_geodetic, geodetic_from_ecef, rotation_ne
from onboard.geometry.rotations import quaternion_from_euler
from onboard.messages import (
    AdsbVehicle,
    AltitudeType,
    Attitude,
    Estimate,
    GlobalPosition,
    LocalPosition,
    PeerPosition,
    RadarDetection,
    RadarScan,
)
from onboard.ownship import Ownship
from onboard.units import NS_PER_S

HOME: Final = (47.397742, 8.545594, 500.0)
ICAO: Final = 0x4B1A2C
NAME: Final = f"icao/{ICAO:06x}"
CAMERA: Final = make_camera(f_px=500.0, width_px=640.0, height_px=480.0)
# An aircraft from home, NED: where it begins, m, and its velocity, m/s.
R0: Final = np.array([2000.0, -500.0, -100.0])
V0: Final = np.array([-30.0, 20.0, 1.0])
NORTH: Final = np.eye(3)[0]
EAST: Final = np.eye(3)[1]


class Sky:
    """Our vehicle near `home`, a tracker, and other aircraft by their offsets from home.

    We fly `speed` m/s along `course_deg`. Offsets are in NED at home, flat enough for metres. Times are seconds on
    the boot clock.
    """

    def __init__(
        self,
        home: tuple[float, float, float] = HOME,
        *,
        speed: float = 0.0,
        course_deg: float = 0.0,
        **config: Any,
    ) -> None:
        self.home = home
        self.course, self.speed = math.radians(course_deg), speed
        self.estimator = Estimator(
            Config(**{"adsb_latency_s": 0.0, "adsb_latency_sigma_s": 0.02} | config), CAMERA
        )
        self.ownship = Ownship(max_extrapolation=0.1)
        self.t = 0.0
        self.newest: dict[str, Estimate] = {}
        self.published: list[Estimate] = []
        self.fly(0.2)

    @property
    def verdicts(self) -> dict[str, int]:
        """Verdicts that occurred, counted."""
        return {str(k): v for k, v in self.estimator.verdicts.items() if v}

    def fly(self, seconds: float) -> None:
        """Let time pass: our own messages at 50 Hz, position over ground at 10 Hz."""
        for _ in range(round(seconds * 50)):
            self.t = round(self.t + 0.02, 6)
            self._own()

    def _own(self) -> None:
        t_ns = round(self.t * NS_PER_S)
        common = {"t_ns": t_ns, "t_recv_ns": t_ns}
        q: Any = tuple(quaternion_from_euler(0.0, 0.0, self.course).tolist())
        v = (self.speed * math.cos(self.course), self.speed * math.sin(self.course), 0.0)
        r = (v[0] * self.t, v[1] * self.t, 0.0)
        self.ownship.receive(Attitude(**common, q_nb=q, omega_b=(0.0, 0.0, 0.0)), t_ns)
        self.ownship.receive(LocalPosition(**common, r_OF_n=r, v_F_n=v), t_ns)
        if round(self.t * 50) % 5 == 0:
            lat, lon, height = self.geodetic(np.array(r))
            here = GlobalPosition(
                **common, lat_deg=lat, lon_deg=lon, alt_msl=height, height=0.0, v_F_n=v, heading_rad=None
            )
            self.ownship.receive(here, t_ns)
            self.estimator.observe(here, self.ownship)
        for e in self.estimator.tick(self.ownship):
            self.newest[e.target] = e
            self.published.append(e)

    def own(self) -> Array:
        """Return our position from home, NED."""
        return np.array([math.cos(self.course), math.sin(self.course), 0.0]) * self.speed * self.t

    def geodetic(self, r: Array) -> tuple[float, float, float]:
        """A place at r from home."""
        return geodetic_from_ecef(ecef_from_geodetic(*self.home) + rotation_ne(*self.home[:2]).T @ r)

    def adsb(self, r: Iterable[float], v: Iterable[float], **changes: Any) -> AdsbVehicle:
        """A report of an aircraft at r from home that flies v, NED there."""
        lat, lon, height = self.geodetic(np.array(list(r)))
        local = rotation_ne(lat, lon) @ rotation_ne(*self.home[:2]).T @ np.array(list(v))
        fields: dict[str, Any] = {
            "icao": ICAO,
            "lat_deg": lat,
            "lon_deg": lon,
            "altitude": height,
            "altitude_type": AltitudeType.GEOMETRIC,
            "course": math.atan2(local[1], local[0]) % (2 * math.pi),
            "ground_speed": math.hypot(local[0], local[1]),
            "climb": -local[2],
        }
        t_ns = round(self.t * NS_PER_S)
        return AdsbVehicle(t_ns=t_ns, t_recv_ns=t_ns, **fields | changes)

    def receive(self, message: AdsbVehicle | PeerPosition) -> None:
        """A message now."""
        self.estimator.observe(message, self.ownship)

    def scan(self, places: Iterable[Iterable[float]]) -> None:
        """A radar scan now, with an echo of each aircraft at r from home; in body axes."""
        t_ns = round(self.t * NS_PER_S)
        c, s = math.cos(self.course), math.sin(self.course)
        echoes = []
        for place in places:
            north, east, down = np.array(list(place)) - self.own()
            x, y = c * north + s * east, c * east - s * north
            echoes.append(
                RadarDetection(
                    range=float(np.sqrt(x * x + y * y + down * down)),
                    azimuth=math.atan2(y, x),
                    elevation=math.atan2(-down, math.hypot(x, y)),
                )
            )
        scan = RadarScan(t_ns=t_ns, t_recv_ns=t_ns, radar="nose", frame="body", detections=tuple(echoes))
        self.estimator.observe(scan, self.ownship)


def mean(e: Estimate) -> Array:
    """The estimate's mean; there must be one."""
    assert e.mean is not None
    return np.array(e.mean)


def fly_with_reports(sky: Sky, seconds: int, r0: Array = R0, v: Array = V0, **changes: Any) -> None:
    """Reports at 1 Hz of an aircraft on a straight line."""
    for _ in range(seconds):
        sky.receive(sky.adsb(r0 + v * sky.t, v, **changes))
        sky.fly(1.0)


def fly_with_scans(sky: Sky, scans: int, *lines: tuple[Array, Array]) -> None:
    """Scans at 10 Hz of aircraft on straight lines."""
    for _ in range(scans):
        sky.scan([r + v * sky.t for r, v in lines])
        sky.fly(0.1)

"""The number of aircraft that one core can track, in seconds of computing for a second of flight.

There are ten radar scans and ten publications a second, and an ADS-B report of each aircraft every second.
"""

import math
import time
from typing import Any, Final

import numpy as np

from onboard.arrays import Array
from onboard.estimators.traffic.config import Config, FilterName
from onboard.estimators.traffic.estimator import Estimator
from onboard.geometry.camera import make_camera
from onboard.geometry.geodesy import ecef_from_geodetic, geodetic_from_ecef, rotation_ne
from onboard.messages import (
    AdsbVehicle,
    AltitudeType,
    Attitude,
    GlobalPosition,
    LocalPosition,
    Message,
    RadarDetection,
    RadarScan,
)
from onboard.ownship import Ownship
from onboard.units import NS_PER_S

COUNTS: Final = (125, 250, 500)
HOME: Final = (47.4, 8.5, 500.0)
OTHERS: Final[tuple[FilterName, ...]] = ("kf", "ekf", "ukf", "srukf")
SPAN: Final = 10_000.0  # m: aircraft are spread over a square of twice this
SETTLING_TIME_S: Final = 2
NAV_HZ, SCAN_HZ = 50, 10


class Sky:
    """`count` aircraft on straight lines, and ourselves in hover; all messages are made beforehand."""

    def __init__(self, count: int, seconds: int, seed: int = 1) -> None:
        rng = np.random.default_rng(seed)
        self._r = np.column_stack([rng.uniform(-SPAN, SPAN, (count, 2)), rng.uniform(-900.0, -100.0, count)])
        course, speed = rng.uniform(0, 2 * math.pi, count), rng.uniform(20.0, 80.0, count)
        self._v = np.column_stack([speed * np.cos(course), speed * np.sin(course), np.zeros(count)])
        self._rng = rng
        self.steps = [self._messages(k) for k in range((SETTLING_TIME_S + seconds) * NAV_HZ)]

    def _messages(self, k: int) -> list[Message]:
        """Return the messages of the k-th fiftieth of a second, our own position first."""
        t = (k + 1) / NAV_HZ
        t_ns = round(t * NS_PER_S)
        stamp: dict[str, Any] = {"t_ns": t_ns, "t_recv_ns": t_ns}
        zero = (0.0, 0.0, 0.0)
        messages: list[Message] = [
            Attitude(**stamp, q_nb=(1.0, 0.0, 0.0, 0.0), omega_b=zero),
            LocalPosition(**stamp, r_OF_n=zero, v_F_n=zero),
        ]
        if k % (NAV_HZ // SCAN_HZ) == 0:
            lat, lon, height = HOME
            place: dict[str, Any] = {"lat_deg": lat, "lon_deg": lon, "alt_msl": height, "height": 0.0}
            messages.append(GlobalPosition(**stamp, **place, v_F_n=zero, heading_rad=None))
            messages.append(self._scan(t, t_ns))
        messages += [self._report(i, t, t_ns) for i in range(k % NAV_HZ, len(self._r), NAV_HZ)]
        return messages

    def _scan(self, t: float, t_ns: int) -> RadarScan:
        r = self._r + self._v * t
        level = np.hypot(r[:, 0], r[:, 1])
        polar = np.column_stack(
            [np.hypot(level, r[:, 2]), np.arctan2(r[:, 1], r[:, 0]), np.arctan2(-r[:, 2], level)]
        )
        polar += self._rng.standard_normal(polar.shape) * [8.0, 0.005, 0.005]
        echoes = tuple(RadarDetection(range=a, azimuth=b, elevation=c) for a, b, c in polar.tolist())
        return RadarScan(t_ns=t_ns, t_recv_ns=t_ns, radar="nose", frame="body", detections=echoes)

    def _report(self, i: int, t: float, t_ns: int) -> AdsbVehicle:
        lat, lon, height = _geodetic(self._r[i] + self._v[i] * (t - 0.4) + self._rng.normal(0, 3.0, 3))
        north, east, _ = self._v[i].tolist()
        return AdsbVehicle(
            t_ns=t_ns,
            t_recv_ns=t_ns,
            icao=i + 1,
            lat_deg=lat,
            lon_deg=lon,
            altitude=height,
            altitude_type=AltitudeType.PRESSURE,
            course=math.atan2(east, north) % (2 * math.pi),
            ground_speed=math.hypot(north, east),
            climb=0.0,
        )


def _geodetic(r: Array) -> tuple[float, float, float]:
    return geodetic_from_ecef(ecef_from_geodetic(*HOME) + rotation_ne(*HOME[:2]).T @ r)


def load(count: int, seconds: int, name: FilterName) -> tuple[float, int]:
    """Return the share of one core that `count` aircraft need with this filter, and the tracked number."""
    config = Config(filter=name, max_reported=COUNTS[-1])
    estimator = Estimator(config, make_camera(f_px=1.0, width_px=1.0, height_px=1.0))
    ownship = Ownship(max_extrapolation=0.1)
    tracked: set[str] = set()
    start = 0.0
    for k, messages in enumerate(Sky(count, seconds).steps):
        if k == SETTLING_TIME_S * NAV_HZ:
            start = time.process_time()
            tracked.clear()
        for message in messages:
            if not ownship.receive(message, message.t_ns):
                estimator.observe(message, ownship)
        tracked.update(e.target for e in estimator.tick(ownship) if e.valid)
    return (time.process_time() - start) / seconds, len(tracked)


def measure(scale: float = 1.0) -> dict[str, float]:
    """Measure the share of one core for each of COUNTS, and for all filters at the largest.

    `per_track_ratio` is the cost per track at the largest count over that at the smallest: 1 is linear.
    """
    seconds = max(1, round(6 * scale))
    load(5, 1, "imm")  # compiled, and warm
    found: dict[str, float] = {}
    for count in COUNTS:
        found[f"imm_{count}"], found[f"imm_{count}_tracked"] = load(count, seconds, "imm")
    for name in OTHERS:
        found[f"{name}_{COUNTS[-1]}"], _ = load(COUNTS[-1], seconds, name)
    few, many = COUNTS[0], COUNTS[-1]
    found["per_track_ratio"] = found[f"imm_{many}"] / many / (found[f"imm_{few}"] / few)
    return found

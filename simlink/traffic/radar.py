"""A radar on our vehicle that looks all round: the phased array of De Vivo et al. (`phased_array`), one panel
beside the other, each steered as far as Table 4 lets it.

Frames: echoes are in b. The signal-to-noise ratio, with the losses of scan and weather and the jammers of those it
looks at, says how well each is measured and whether it is seen: an echo that fluctuates from scan to scan
(Swerling's first case) passes a threshold of false-alarm probability P with probability P^(1/(1+S)). An aircraft
is no point: its echo comes from somewhere on it (glint), which the radar does not know of.
"""

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from onboard.messages import Clock, Quaternion, RadarDetection, RadarDetections, Vec3
from simlink.scenarios.scene import Interval, TrafficRadar
from simlink.sensors import phased_array
from simlink.world import attitude
from simlink.world.noise import normals, uniforms

Array = npt.NDArray[np.float64]

DRAWS: Final = 6  # normal numbers for each aircraft and scan, seen or not: three of glint, three of noise


class RadarSensor:
    """Noise, missed echoes, false alarms, jamming, loss of all signal."""

    def __init__(self, radar: TrafficRadar, seed: int) -> None:
        self._radar = radar
        self._array = phased_array.Radar(jammer_power=radar.jammer_power)
        self._u, self._z = uniforms(seed, "traffic.radar.link"), normals(seed, "traffic.radar.noise")
        # the weakest signal that is seen one time in two: what a false alarm looks like
        self._weakest = math.log(radar.false_alarm_probability) / math.log(0.5) - 1.0

    def scan(
        self, t: float, t_ns: int, q_nF: Quaternion, others: list[Vec3]
    ) -> tuple[RadarDetections, list[bool]]:
        """The scan now of others at r_FT_n, and which of them are in it."""
        radar, count = self._radar, len(others)
        jammed = _within(t, radar.jammed)
        body = np.array([attitude.to_b(q_nF, other) for other in others]).reshape(count, 3)
        draws = np.array([next(self._z) for _ in range(count * DRAWS)]).reshape(count, DRAWS)
        chance = np.array([next(self._u) for _ in others])
        polar = _polar(body)
        ratio, sigma = self._quality(polar, -np.array(others).reshape(count, 3)[:, 2], jammed)
        p_detect = radar.p_detect * radar.false_alarm_probability ** (1.0 / (1.0 + ratio))
        can = phased_array.in_scan(self._array, self._on_panel(polar)) & (polar[:, 0] <= radar.range_max)
        hit = can & (chance < p_detect) & (not _within(t, radar.lost))
        measured = _polar(body + radar.glint * draws[:, :3]) + sigma * draws[:, 3:]
        detections = [_detection(measured[i], sigma[i], float(ratio[i])) for i in np.flatnonzero(hit)]
        if not _within(t, radar.lost):
            detections += self._false_alarms(radar.jammed_false_alarms if jammed else radar.false_alarms)
        detections.sort(key=lambda d: d.azimuth)  # so that their order tells nothing
        found = tuple(detections)
        return RadarDetections(t_ns=t_ns, clock=Clock.BOOT, radar=radar.name, detections=found), hit.tolist()

    def _quality(self, polar: Array, height: Array, jammed: bool) -> tuple[Array, Array]:
        """Integrated signal to noise (k,), or to noise and jamming, and standard deviations (k, 3)."""
        seen, jammers = self._on_panel(polar), np.full(len(polar), jammed)
        rain, size = self._radar.rain_mm_h, self._radar.cross_section
        one = phased_array.signal_to_noise(self._array, seen, height, rain, jammers, size)
        ratio = phased_array.integrated(self._array, one)
        return ratio, phased_array.accuracy(self._array, seen, ratio)

    def _on_panel(self, polar: Array) -> Array:
        """Range, azimuth and elevation (k, 3) as the panel sees them that looks there."""
        width = 2 * math.pi / self._radar.panels
        seen = polar.copy()
        seen[:, 1] = np.remainder(polar[:, 1] + width / 2, width) - width / 2
        return seen

    def _false_alarms(self, mean: float) -> list[RadarDetection]:
        radar = self._radar
        alarms = []
        for _ in range(self._poisson(mean)):
            # as many per square metre of range ring near as far: range goes with the root
            far, around, up = next(self._u), next(self._u), next(self._u)
            elevation = math.radians(radar.elevation_deg) * (2 * up - 1)
            polar = np.array([radar.range_max * math.sqrt(far), 2 * math.pi * around, elevation])
            ratio = np.array([self._weakest])
            sigma = phased_array.accuracy(self._array, self._on_panel(polar[None]), ratio)[0]
            alarms.append(_detection(polar, sigma, self._weakest))
        return alarms

    def _poisson(self, mean: float) -> int:
        """Knuth's product of uniforms."""
        limit, product, count = math.exp(-mean), next(self._u), 0
        while product > limit:
            product *= next(self._u)
            count += 1
        return count


def _detection(polar: Array, sigma: Array, ratio: float) -> RadarDetection:
    distance, azimuth, elevation = polar.tolist()
    of_range, of_azimuth, of_elevation = sigma.tolist()
    return RadarDetection(
        range=max(distance, 1.0),
        azimuth=math.remainder(azimuth, 2 * math.pi),
        elevation=min(max(elevation, -math.pi / 2), math.pi / 2),
        sigma=(of_range, of_azimuth, of_elevation),
        snr_db=10.0 * math.log10(ratio),
    )


def _polar(body: Array) -> Array:
    """Range, azimuth (positive right of b's first axis) and elevation (positive up), (k, 3), of points in b."""
    x, y, z = body[:, 0], body[:, 1], body[:, 2]
    level = np.hypot(x, y)
    return np.column_stack([np.hypot(level, z), np.arctan2(y, x), np.arctan2(-z, level)])


def _within(t: float, intervals: tuple[Interval, ...]) -> bool:
    return any(i.start <= t < i.end for i in intervals)

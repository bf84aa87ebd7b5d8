"""A radar on our vehicle that sees all round, with several phased arrays (`phased_array`).

Each panel is steered within the limits of Table 4 of De Vivo et al., and detections are in b. The signal-to-noise
ratio S follows from the losses of scan and weather and the targets' jammers. It sets the accuracy and the
probability of detection: a Swerling-1 echo passes a threshold of false-alarm probability P with probability
P^(1/(1+S)). The reflecting point moves over the aircraft (glint), which the reported accuracy does not contain.
"""

import math
from typing import Final

import numpy as np

from onboard.messages import Clock, Quaternion, RadarDetection, RadarDetections, Vec3
from simlink.scenarios.profiles import is_within
from simlink.scenarios.traffic import TrafficRadar
from simlink.sensors import phased_array
from simlink.sensors.arrays import Array
from simlink.world import attitude
from simlink.world.noise import normals, uniforms

NORMAL_SAMPLES: Final = 6  # per aircraft and scan, detected or not: three for glint, three for noise


class RadarSensor:
    """The radar of one run, with noise, missed echoes, false alarms and outages."""

    def __init__(self, radar: TrafficRadar, seed: int) -> None:
        self._radar = radar
        self._array = phased_array.Radar(jammer_power=radar.jammer_power)
        self._u, self._z = uniforms(seed, "traffic.radar.link"), normals(seed, "traffic.radar.noise")
        # the signal that is detected one time in two: the strength of a false alarm
        self._weakest = math.log(radar.false_alarm_probability) / math.log(0.5) - 1.0

    def scan(
        self, t: float, t_ns: int, q_nF: Quaternion, others: list[Vec3]
    ) -> tuple[RadarDetections, list[bool]]:
        """Scan the aircraft at r_FT_n at flight time t (s); return the scan and who is in it."""
        radar, count = self._radar, len(others)
        jammed = is_within(t, radar.jammed)
        body = np.array([attitude.to_b(q_nF, other) for other in others]).reshape(count, 3)
        draws = np.array([next(self._z) for _ in range(count * NORMAL_SAMPLES)]).reshape(count, NORMAL_SAMPLES)
        chance = np.array([next(self._u) for _ in others])
        polar = _polar(body)
        ratio, sigma = self._quality(polar, -np.array(others).reshape(count, 3)[:, 2], jammed)
        p_detect = radar.p_detect * radar.false_alarm_probability ** (1.0 / (1.0 + ratio))
        reachable = phased_array.in_scan(self._array, self._on_panel(polar)) & (polar[:, 0] <= radar.range_max)
        hit = reachable & (chance < p_detect) & (not is_within(t, radar.lost))
        measured = _polar(body + radar.glint * draws[:, :3]) + sigma * draws[:, 3:]
        detections = [_detection(measured[i], sigma[i], float(ratio[i])) for i in np.flatnonzero(hit)]
        if not is_within(t, radar.lost):
            detections += self._false_alarms(radar.jammed_false_alarms if jammed else radar.false_alarms)
        detections.sort(key=lambda d: d.azimuth)  # so that the order does not identify them
        found = tuple(detections)
        return RadarDetections(t_ns=t_ns, clock=Clock.BOOT, radar=radar.name, detections=found), hit.tolist()

    def _quality(self, polar: Array, height: Array, jammed: bool) -> tuple[Array, Array]:
        """Return the integrated S/N (k,) and the standard deviations (k, 3) as in `accuracy`.

        When jammed the ratio is S/(J+N).
        """
        on_panel, jammers = self._on_panel(polar), np.full(len(polar), jammed)
        rain, size = self._radar.rain_mm_h, self._radar.cross_section
        one = phased_array.signal_to_noise(self._array, on_panel, height, rain, jammers, size)
        ratio = phased_array.integrated(self._array, one)
        return ratio, phased_array.accuracy(self._array, on_panel, ratio)

    def _on_panel(self, polar: Array) -> Array:
        """Return range, azimuth and elevation (k, 3) in the axes of each target's panel."""
        width = 2 * math.pi / self._radar.panels
        on_panel = polar.copy()
        on_panel[:, 1] = np.remainder(polar[:, 1] + width / 2, width) - width / 2
        return on_panel

    def _false_alarms(self, mean: float) -> list[RadarDetection]:
        radar = self._radar
        alarms = []
        for _ in range(self._poisson(mean)):
            # uniform density over the disc: the range is the square root of a uniform draw
            far, around, up = next(self._u), next(self._u), next(self._u)
            elevation = math.radians(radar.elevation_deg) * (2 * up - 1)
            polar = np.array([radar.range_max * math.sqrt(far), 2 * math.pi * around, elevation])
            ratio = np.array([self._weakest])
            sigma = phased_array.accuracy(self._array, self._on_panel(polar[None]), ratio)[0]
            alarms.append(_detection(polar, sigma, self._weakest))
        return alarms

    def _poisson(self, mean: float) -> int:
        """Return a Poisson number, by Knuth's product of uniforms."""
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
    """Return range, azimuth (right) and elevation (up), (k, 3), of points in b."""
    x, y, z = body[:, 0], body[:, 1], body[:, 2]
    level = np.hypot(x, y)
    return np.column_stack([np.hypot(level, z), np.arctan2(y, x), np.arctan2(-z, level)])

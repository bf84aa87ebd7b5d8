"""A camera's gimbal: level, turned with our heading, sweeping; and what it says of itself, off by what lasts."""

import math
from collections.abc import Iterator
from typing import Final, Literal, NamedTuple

import numpy as np

from onboard.messages import GimbalAttitude, MountAttitude, Quaternion
from simlink.encounters.conditions import Conditions
from simlink.encounters.curves import wobble
from simlink.encounters.truth import EncounterTruth, at
from simlink.scenarios.profiles import GaussMarkov
from simlink.sensors.arrays import Array
from simlink.world import attitude
from simlink.world.drawn import Range
from simlink.world.noise import stream

Mount = Literal["fixed", "gimbal"]
MOUNTS: Final[tuple[Mount, ...]] = ("fixed", "gimbal")
COMPONENT: Final = 154  # MAV_COMP_ID_GIMBAL
# A small gimbal finds the horizon by its accelerometers, as an autopilot does, and its yaw by gyros alone, which
# drift by 10 to 50 degrees an hour; motor encoders and belts leave some tenths of a degree more.
TILT_DEG: Final[Range] = (0.2, 0.8)  # standard deviations
YAW_DEG: Final[Range] = (0.5, 1.6)
ERROR_S: Final[Range] = (40.0, 300.0)
SWEEP_DEG: Final[tuple[Range, Range]] = ((4.0, 14.0), (2.0, 6.0))  # yaw and pitch, to either side
PERIOD_S: Final[tuple[Range, Range]] = ((4.0, 9.0), (2.5, 6.0))
RATE_HZ: Final[Range] = (8.0, 30.0)
LATENCY_S: Final[Range] = (0.002, 0.03)


class SweepingGimbal(NamedTuple):
    """The head's yaw against our heading and its pitch against the horizon (N,), rad; the errors of its word about
    forward, right and down (N, 3), rad; how often it speaks, Hz, and how late, s."""

    t: Array
    yaw: Array
    pitch: Array
    error: Array
    rate: float
    latency: float

    def head(self, t: float) -> Quaternion:
        """From the head's axes to NED turned to our heading."""
        return attitude.from_euler(
            0.0, float(np.interp(t, self.t, self.pitch)), float(np.interp(t, self.t, self.yaw))
        )

    def q_bc(self, t: float, q_nF: Quaternion) -> Quaternion:
        """Of the camera, whose axes are the head's."""
        w, x, y, z = q_nF
        heading = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        q_nc = attitude.product(attitude.from_euler(0.0, 0.0, heading), self.head(t))
        return attitude.product(attitude.conjugate(q_nF), q_nc)

    def reports(self, seed: int, boot_ns: int, epoch_ns: int) -> Iterator[GimbalAttitude]:
        """What it says; its errors are those of its own level and north, not of its head."""
        phase = stream(seed, "encounters.gimbal.phase").uniform(0.0, 1.0)
        for t in np.arange(phase / self.rate, self.t[-1], 1.0 / self.rate).tolist():
            (off,) = at(self.t, self.error, np.array([t])).tolist()
            q = attitude.product(attitude.from_vector(*off), self.head(t))
            ns = boot_ns + round(t * 1e9)
            yield GimbalAttitude(
                t_ns=ns,
                t_recv_ns=epoch_ns + ns + round(self.latency * 1e9),
                component=COMPONENT,
                device=COMPONENT,
                mount=MountAttitude(q=q, frame="heading"),
            )


def draw_gimbal(truth: EncounterTruth, conditions: Conditions, seed: int) -> SweepingGimbal:
    """The gimbal of one encounter. It sweeps about where the fixed camera would look."""
    rng, t = stream(seed, "encounters.gimbal"), truth.t
    _, _, aside = np.radians(conditions.camera.mount_rpy_deg)
    yaw, pitch = (
        np.radians(rng.uniform(*width)) * np.sin(2 * np.pi * (t / rng.uniform(*period) + rng.uniform()))
        for width, period in zip(SWEEP_DEG, PERIOD_S, strict=True)
    )
    tilt, drift, lasts = (float(rng.uniform(*among)) for among in (TILT_DEG, YAW_DEG, ERROR_S))
    error = np.column_stack(
        [
            wobble(seed, f"encounters.gimbal.{axis}", GaussMarkov(sigma=sigma, time=lasts), len(t), np.pi / 180)
            for axis, sigma in (("x", tilt), ("y", tilt), ("z", drift))
        ]
    )
    return SweepingGimbal(
        t, aside + yaw, pitch, error, float(rng.uniform(*RATE_HZ)), float(rng.uniform(*LATENCY_S))
    )

"""A camera on a sweeping gimbal with a distorted lens; OpenCV computes the pixels."""

import json
import math
from typing import Any, Final, NamedTuple

import cv2
import numpy as np

from onboard.arrays import Array
from onboard.config import Config
from onboard.geometry.rotations import matrix_from_euler, quaternion_from_matrix
from onboard.messages import Datagram, Encoding, GimbalAttitude, MountAttitude, MountFrame, TargetPoints
from onboard.wire.mavlink.encode import MavlinkEncoder
from tests.support.streams import EPOCH, MS, Flight, Run, S, Stream, encode, feed

FLAT: Final = (0.0,) * 5
BARREL: Final = (-0.2812, 0.0711, 0.0012, -0.0009, 0.011)
LENS: Final = {"f_px": 520.3, "fy_px": 518.7, "cx_px": 318.9, "cy_px": 243.1}
NAMES: Final = ("center", "left", "right")
GIMBAL: Final = 154  # MAV_COMP_ID_GIMBAL
LOOP: Final = Flight(radius=300.0)


class Mount(NamedTuple):
    """The motion of the gimbal's head, and how it is reported."""

    yaw: float = 15.0  # degrees, amplitude against our heading
    pitch: float = 6.0  # degrees, amplitude against the horizon
    frame: MountFrame = "heading"  # of its report
    period_ms: int = 100  # of its reports
    late_ms: int = 15  # their latency
    behind_ms: int = 0  # of its clock against ours
    error_deg: float = 0.0

    def against_horizon(self, t: float) -> Array:
        """R_hc (3, 3), h being NED turned to our heading."""
        yaw, pitch = self.yaw * math.sin(2 * math.pi * t / 6.0), self.pitch * math.sin(2 * math.pi * t / 3.7)
        return matrix_from_euler(0.0, math.radians(pitch), math.radians(yaw))

    def attitude(self, t: float, flight: Flight) -> MountAttitude:
        """Return the gimbal's report."""
        rpy = flight.at(t).rpy
        tilted = self.against_horizon(t) @ matrix_from_euler(0.0, *np.radians([self.error_deg, self.error_deg]))
        R_nh = matrix_from_euler(0.0, 0.0, rpy[2])
        R = {
            "heading": tilted,
            "earth": R_nh @ tilted,
            "body": matrix_from_euler(*rpy).T @ R_nh @ tilted,
        }[self.frame]
        return MountAttitude(q=tuple(quaternion_from_matrix(R).tolist()), frame=self.frame)


def pixels(flight: Flight, t: float, R_nc: Array, distortion: tuple[float, ...]) -> Array:
    """Return center, left and right (3, 2) as projected by OpenCV, whose camera looks along z."""
    follower, leader = flight.at(t), flight.at(t, flight.gap)
    wing = matrix_from_euler(*leader.rpy)[:, 1] * flight.size / 2
    r_c = np.array([R_nc.T @ (leader.r + offset - follower.r) for offset in (0 * wing, -wing, wing)])
    k = np.array([[LENS["f_px"], 0, LENS["cx_px"]], [0, LENS["fy_px"], LENS["cy_px"]], [0, 0, 1]])
    drawn, _ = cv2.projectPoints(r_c[:, [1, 2, 0]].copy(), np.zeros(3), np.zeros(3), k, np.array(distortion))
    return np.asarray(drawn).reshape(3, 2)


def flown(
    settings: Config,
    mount: Mount | None,
    *,
    seed: int,
    seconds: float = 15.0,
    in_image: bool = False,
    flight: Flight = LOOP,
    distortion: tuple[float, ...] = BARREL,
    sparse: bool = False,
) -> Run:
    """A flight with a pixel of noise.

    Without a `mount` the camera is fixed to the body; `in_image`: the attitude comes with each image, else from
    the gimbal; `sparse`: at half the rates.
    """
    rng = np.random.default_rng(seed)
    encoder = MavlinkEncoder(1, GIMBAL)
    timed: list[tuple[int, Datagram]] = []
    for item in Stream(flight=flight, t1=5.0 + seconds, seed=None, sparse=sparse).items():
        t_ns = item.message.t_ns
        if not isinstance(item.message, TargetPoints):
            timed += [(item.t_recv_ns, d) for d in encode([item])]
            continue
        t, body = t_ns / S, matrix_from_euler(*flight.at(t_ns / S).rpy)
        heading = matrix_from_euler(0.0, 0.0, flight.at(t).rpy[2])
        R_nc = body if mount is None else heading @ mount.against_horizon(t)
        noisy = (pixels(flight, t, R_nc, distortion) + rng.normal(size=(3, 2))).tolist()
        points = {n: {"u_px": u, "v_px": v} for n, (u, v) in zip(NAMES, noisy, strict=True)}
        sent: dict[str, Any] = {
            "t_ns": t_ns,
            "clock": "boot",
            "detections": [{"points": points, "target": "leader"}],
        }
        if mount is not None and in_image:
            attitude = mount.attitude(t, flight)
            sent["attitude"] = {"q": attitude.q, "frame": attitude.frame}
        data = json.dumps(sent).encode()
        kind = Encoding.DETECTIONS
        timed.append((item.t_recv_ns, Datagram(channel="k", encoding=kind, t_recv_ns=item.t_recv_ns, data=data)))
    for ms in range(5000, round(1000 * (5.0 + seconds)), mount.period_ms) if mount and not in_image else ():
        arrival = EPOCH + (ms + mount.late_ms) * MS
        report = GimbalAttitude(
            t_ns=(ms - mount.behind_ms) * MS,
            t_recv_ns=arrival,
            component=GIMBAL,
            device=GIMBAL,
            mount=mount.attitude(ms / 1000, flight),
        )
        data = encoder.encode(report)
        timed.append((arrival, Datagram(channel="g", encoding=Encoding.MAVLINK, t_recv_ns=arrival, data=data)))
    return feed([d for _, d in sorted(timed, key=lambda pair: pair[0])], settings)


def range_error(run: Run, after: float, flight: Flight = LOOP) -> float:
    """Return the RMS range error of valid estimates later than `after` s of boot time, m."""
    late = [e for e in run.estimates if e.valid and e.t_ns > after * S]
    found = [
        math.hypot(*e.mean[:3]) - float(np.linalg.norm(flight.relative(e.t_ns / S)[0]))
        for e in late
        if e.mean is not None
    ]
    assert len(found) > 100
    return float(np.sqrt(np.mean(np.square(found))))

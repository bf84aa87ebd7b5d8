"""Client for detectors in Python: send detections to a running daemon.

    with Camera() as camera:
        camera.send({"left": (310.4, 226.0), "right": (352.1, 223.7)}, t_ns=time_of_exposure)

The daemon reports refused detections on its standard error and in its health.
"""

import math
import time
from collections.abc import Iterable, Mapping
from types import TracebackType
from typing import Any, Final, Self

import msgspec
import numpy as np

from onboard.messages import (
    Box,
    CameraDetections,
    Clock,
    DetectedPoint,
    DetectedPose,
    Detection,
    Intrinsics,
    MountAttitude,
)
from onboard.sinks.zenoh_session import ZenohConfig, wait_for_session

ENDPOINT: Final = "tcp/127.0.0.1:7447"

Point = tuple[float, float] | tuple[float, float, float]


class Camera:
    """A connection to the daemon for one camera.

    A detector may start before the daemon: the constructor waits for it, and says so on standard error. A daemon
    that restarts later is found again.

    Parameters
    ----------
    name
        Name of the camera; empty: the daemon's first one.
    endpoint
        The daemon's Zenoh endpoint.
    vehicle
        The daemon's vehicle, a part of the key.
    clock
        Clock of the times of exposure; Unix time by default.
    wait_s
        How long to wait for the daemon, s.

    Raises
    ------
    SinkError
        If no daemon answers in time.
    """

    def __init__(
        self,
        name: str = "",
        *,
        endpoint: str = ENDPOINT,
        vehicle: str = "1",
        clock: Clock = Clock.HOST,
        wait_s: float = math.inf,
    ) -> None:
        config = ZenohConfig(vehicle=vehicle, mode="client", listen=(), connect=(endpoint,))
        self._name, self._clock = name, clock
        self._session = wait_for_session(config, wait_s)
        self._key = f"{config.prefix}/camera/{name or 'any'}/detections"

    def send(
        self,
        points: Mapping[str, Point] | None = None,
        *,
        box: tuple[float, float, float, float] | None = None,
        pose: DetectedPose | None = None,
        t_ns: int | None = None,
        target: str = "",
        class_name: str = "",
        confidence: float | None = None,
        range_m: float | None = None,
        intrinsics: Intrinsics | None = None,
        attitude: MountAttitude | None = None,
    ) -> None:
        """Send one aircraft in one image, given by points, a box, a pose, or several of these.

        Parameters
        ----------
        points
            Any of `center`, `left`, `right` and the points of its class, each (u, v) or (u, v, sigma) in pixels.
        box
            Middle u and v, width and height, in pixels.
        pose
            Pose of the aircraft in the camera's axes, see `pose_of`.
        t_ns
            Time of exposure on the camera's clock, ns. None: now, which is late by the duration of the detection.
        target, class_name, confidence, range_m
            As in `messages.Detection`.
        intrinsics
            Intrinsics of this image; None: as configured.
        attitude
            Attitude of a moving mount at exposure.
        """
        detection = Detection(
            points={name: _point(p) for name, p in (points or {}).items()},
            box=None if box is None else _box(box),
            pose=pose,
            target=target,
            class_name=class_name,
            confidence=None if confidence is None else float(confidence),
            range_m=None if range_m is None else float(range_m),
        )
        self.send_all([detection], t_ns=t_ns, intrinsics=intrinsics, attitude=attitude)

    def send_all(
        self,
        detections: Iterable[Detection],
        *,
        t_ns: int | None = None,
        intrinsics: Intrinsics | None = None,
        attitude: MountAttitude | None = None,
    ) -> None:
        """Send all aircraft of one image at once.

        Parameters
        ----------
        detections
            The aircraft.
        t_ns, intrinsics, attitude
            As in `send`.
        """
        document = CameraDetections(
            t_ns=time.time_ns() if t_ns is None else int(t_ns),
            clock=Clock.HOST if t_ns is None else self._clock,
            camera=self._name,
            intrinsics=intrinsics,
            attitude=attitude,
            detections=tuple(detections),
        )
        self._session.put(self._key, msgspec.json.encode(document, enc_hook=_plain))

    def close(self) -> None:
        """Close the connection."""
        self._session.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def pose_of(rvec: Any, tvec: Any, covariance: Any = None) -> DetectedPose:
    """Convert the pose that OpenCV's solvePnP returns.

    The points of the aircraft must be in its own axes: forward, right and down from its center.

    Parameters
    ----------
    rvec, tvec
        Rotation vector, rad, and translation, m: three numbers in any shape.
    covariance
        Covariance (6, 6) of the position, m^2, and then of the rotation about the camera's axes, rad^2.

    Returns
    -------
    DetectedPose
        The pose, for `Camera.send`.

    Raises
    ------
    msgspec.ValidationError
        If the covariance is not 6 x 6.
    """
    turn = np.ravel(np.asarray(rvec, dtype=float))
    angle = float(np.linalg.norm(turn))
    i, j, k = (turn * (math.sin(angle / 2) / angle if angle > 0.0 else 0.5)).tolist()
    w = math.cos(angle / 2)
    x, y, z = np.ravel(np.asarray(tvec, dtype=float)).tolist()
    rows = None if covariance is None else np.asarray(covariance, dtype=float).tolist()
    return msgspec.convert({"position_m": (x, y, z), "q": (w, i, j, k), "covariance": rows}, DetectedPose)


def _plain(value: Any) -> Any:
    """Convert NumPy's numbers and arrays to the types that JSON has."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise NotImplementedError(f"a {type(value).__name__} is no part of a detection")


def _point(p: Any) -> DetectedPoint:
    """Convert (u, v) or (u, v, sigma), of any numeric type, in pixels."""
    u_px, v_px, *sigma = map(float, p)  # also of NumPy's numbers
    return DetectedPoint(u_px=u_px, v_px=v_px, sigma_px=sigma[0] if sigma else None)


def _box(sides: Iterable[float]) -> Box:
    """Convert the middle u and v, width and height, in pixels."""
    u_px, v_px, width_px, height_px = map(float, sides)
    return Box(u_px=u_px, v_px=v_px, width_px=width_px, height_px=height_px)

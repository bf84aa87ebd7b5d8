"""The share of one core that many leaders need, for the whole pipeline from bytes to bytes.

Each leader has 30 images a second, 40 ms late, beside 50 samples of our own motion. Figures are seconds of
computing for a second of flight. `without_id` is the ratio of the time of an image without an id, whose track must
be found by association.
"""

import math
import time
from typing import Any, Final

import msgspec
import numpy as np

from onboard.config import load_config
from onboard.messages import (
    Attitude,
    CameraPoints,
    Clock,
    Datagram,
    Encoding,
    Estimate,
    Heartbeat,
    Intrinsics,
    LocalPosition,
    Message,
    Pixel,
    Verdict,
)
from onboard.pipeline import Pipeline
from onboard.wire.mavlink.encode import MavlinkEncoder

COUNT: Final = 100
SETTLING_TIME_S: Final = 1
NAV_MS, IMAGE_MS, LATE_MS = 20, 1000 / 30, 40
MS: Final = 1_000_000
EPOCH: Final = 1_735_689_600_000 * MS
F_PX, CX_PX, CY_PX = 554.256, 320.0, 240.0
INTRINSICS: Final = Intrinsics(fx_px=F_PX, fy_px=F_PX, cx_px=CX_PX, cy_px=CY_PX)
SPEED, SPAN = 15.0, 2.0
SWAY_AMPLITUDE: Final = 0.05  # rad, of our nose
RUN_COUNT: Final = 5


def flight(count: int, seconds: int, seed: int = 1, first: str = "target/0") -> list[Datagram]:
    """Return the datagrams, in order of arrival, of `count` leaders that fly straight on with us.

    Our nose sways a little; `first` is the id of the first leader.
    """
    rng = np.random.default_rng(seed)
    bearing, range_ = rng.uniform(-0.35, 0.35, count), rng.uniform(15.0, 60.0, count)
    r = np.column_stack(
        [range_ * np.cos(bearing), range_ * np.sin(bearing), range_ * rng.uniform(-0.2, 0.2, count)]
    )
    wing = np.array([0.0, SPAN / 2, 0.0])
    encoder, points = MavlinkEncoder(1, 1), msgspec.json.Encoder()
    arrivals: list[tuple[int, Encoding, bytes]] = []
    for k in range(seconds * 1000 // NAV_MS):
        t_ns = 5_000 * MS + k * NAV_MS * MS
        yaw = SWAY_AMPLITUDE * math.sin(t_ns * 1e-9)
        stamp: dict[str, Any] = {"t_ns": t_ns, "t_recv_ns": EPOCH + t_ns}
        messages: list[Message] = [
            Attitude(
                **stamp,
                q_nb=(math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)),
                omega_b=(0.0, 0.0, SWAY_AMPLITUDE * math.cos(t_ns * 1e-9)),
            ),
            LocalPosition(**stamp, r_OF_n=(SPEED * t_ns * 1e-9, 0.0, -50.0), v_F_n=(SPEED, 0.0, 0.0)),
        ]
        if k % 50 == 0:
            messages.insert(0, Heartbeat(**stamp, vehicle_type=2, autopilot=12, armed=True, status=4))
        arrivals += [(EPOCH + t_ns + MS, Encoding.MAVLINK, encoder.encode(message)) for message in messages]
    for k in range(round(seconds * 1000 / IMAGE_MS)):
        t_ns = 5_000 * MS + round(k * IMAGE_MS * MS)
        c, s = math.cos(SWAY_AMPLITUDE * math.sin(t_ns * 1e-9)), math.sin(SWAY_AMPLITUDE * math.sin(t_ns * 1e-9))
        r_c = np.stack([r, r - wing, r + wing], axis=1) @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        pixels = F_PX * r_c[..., 1:] / r_c[..., :1] + [CX_PX, CY_PX] + rng.standard_normal((count, 3, 2))
        for i, (center, left, right) in enumerate(pixels.tolist()):
            image = CameraPoints(
                t_ns=t_ns,
                clock=Clock.BOOT,
                camera="front",
                intrinsics=INTRINSICS,
                center=Pixel(u_px=center[0], v_px=center[1]),
                left=Pixel(u_px=left[0], v_px=left[1]),
                right=Pixel(u_px=right[0], v_px=right[1]),
                target=f"target/{i}" if i else first,
            )
            arrivals.append((EPOCH + t_ns + LATE_MS * MS, Encoding.POINTS, points.encode(image)))
    arrivals.sort(key=lambda arrival: arrival[0])
    return [Datagram(channel=how, encoding=how, t_recv_ns=at, data=data) for at, how, data in arrivals]


def measure(scale: float = 1.0) -> dict[str, float]:
    """Measure the load of COUNT leaders.

    Returns the share of one core, the microseconds for each image with everything else, and the share of images
    that were fused.
    """
    _load(2, 1)  # compiled, and warm
    seconds = max(1, round(5 * scale))
    share, fused = _load(COUNT, seconds)
    return {
        "targets": COUNT,
        "one_core": share,
        "us_per_image": 1e6 * share / (COUNT * 1000 / IMAGE_MS),
        "fused": fused,
        "without_id": _without_id(seconds),
    }


def _without_id(seconds: int) -> float:
    """Return the time of a leader without ids over that with ids, the best of alternate runs."""
    runs = [[_load(1, seconds, first)[0] for first in ("leader", "")] for _ in range(RUN_COUNT)]
    named, unnamed = np.min(runs, axis=0).tolist()
    return float(unnamed / named)


def _load(count: int, seconds: int, first: str = "target/0") -> tuple[float, float]:
    """Return (share of one core, share of fused images) once all tracks have started."""
    pipeline, encoder = (
        Pipeline(load_config(None, (f"estimator.leader.size_prior_m={SPAN}",))),
        msgspec.json.Encoder(),
    )
    verdicts: list[Verdict] = []
    began, since_ns = 0.0, EPOCH + (5_000 + 1_000 * SETTLING_TIME_S) * MS
    for datagram in flight(count, SETTLING_TIME_S + seconds, first=first):
        if not began and datagram.t_recv_ns >= since_ns:
            began = time.process_time()
            verdicts.clear()
        for output in pipeline.feed(datagram):
            encoder.encode(output)
            if isinstance(output, Estimate) and output.measurement is not None:
                verdicts.append(output.measurement.verdict)
    return (time.process_time() - began) / seconds, sum(v is Verdict.FUSED for v in verdicts) / len(verdicts)

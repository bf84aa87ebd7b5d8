"""`python -m benchmarks.soak --hours 24`: a long flight through the pipeline at full speed.

It has a hundred samples of the IMU a second, 50 of own motion and 25 images. Every simulated hour it prints, as
JSON, the memory, threads and open files of this process, the error of the clock offset, and the estimates. These
must stay constant: `grown_mb` is memory relative to the first figures.
"""

import argparse
import json
import math
import sys
import time
from collections.abc import Iterator
from typing import Any, Final

import psutil

from onboard.config import load_config
from onboard.messages import (
    Attitude,
    Datagram,
    Encoding,
    Estimate,
    Heartbeat,
    Imu,
    LocalPosition,
    Message,
    SystemTime,
    TargetPoints,
)
from onboard.pipeline import Pipeline
from onboard.wire.mavlink.encode import MavlinkEncoder

MS: Final = 1_000_000
EPOCH: Final = 1_735_689_600_000 * MS
DRIFT: Final = 20e-6  # of the boot clock against ours
LINK_LATENCY_MS: Final = 2
SWAY_AMPLITUDE: Final = 0.05  # rad
SPEED, GAP, SPAN = 12.0, 25.0, 2.0
Numbers = dict[str, Any]


def flight(hours: float, image_ms: int) -> Iterator[Datagram]:
    """Yield the datagrams of a straight flight behind a leader that keeps its distance."""
    encoder, camera = MavlinkEncoder(1, 1), MavlinkEncoder(1, 191)
    for k in range(round(hours * 3_600_000 / 10)):
        t_ms = 5_000 + 10 * k
        for message in _due(t_ms, image_ms):
            one = camera if isinstance(message, TargetPoints) else encoder
            yield Datagram(
                channel="soak",
                encoding=Encoding.MAVLINK,
                t_recv_ns=arrival_ns(t_ms),
                data=one.encode(message),
            )


def arrival_ns(t_ms: int) -> int:
    """Return when a message of a boot time arrives, on this computer's clock."""
    return EPOCH + round(t_ms * MS * (1 + DRIFT)) + LINK_LATENCY_MS * MS


def _due(t_ms: int, image_ms: int) -> Iterator[Message]:
    t = t_ms * 1e-3
    head: dict[str, Any] = {"t_ns": t_ms * MS, "t_recv_ns": arrival_ns(t_ms)}
    yaw, rate = SWAY_AMPLITUDE * math.sin(t), SWAY_AMPLITUDE * math.cos(t)
    yield Imu(**head, f_b=(0.0, 0.0, -9.81), omega_b=(0.0, 0.0, rate))
    if t_ms % 1000 == 0:
        yield Heartbeat(**head, vehicle_type=2, autopilot=12, armed=True, status=4)
        yield SystemTime(**head, unix_ns=arrival_ns(t_ms))
    if t_ms % 20 == 0:
        yield Attitude(**head, q_nb=(math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)), omega_b=(0.0, 0.0, rate))
        yield LocalPosition(**head, r_OF_n=(SPEED * t, 0.0, -50.0), v_F_n=(SPEED, 0.0, 0.0))
    if t_ms % image_ms == 0:
        yield _image(head, yaw)


def _image(head: dict[str, Any], yaw: float) -> TargetPoints:
    def point(y: float) -> tuple[float, float]:
        c, s = math.cos(yaw), math.sin(yaw)
        return (-s * GAP + c * y) / (c * GAP + s * y), 0.02

    points = point(0.0), point(-SPAN / 2), point(SPAN / 2)
    return TargetPoints(**head, camera="front", target="leader", center=points[0], left=points[1], right=points[2])


class Watch:
    """Counts estimates, and measures the process once an hour."""

    def __init__(self, pipeline: Pipeline) -> None:
        self._pipeline, self._process = pipeline, psutil.Process()
        self._began = time.perf_counter()
        self._first_mb: float | None = None
        self.estimates = self.valid = 0

    def count(self, output: Any) -> None:
        """Count an output."""
        if isinstance(output, Estimate):
            self.estimates += 1
            self.valid += output.valid

    def hour(self, hours: float, t_ms: int) -> Numbers:
        """Return the present figures."""
        memory = self._process.memory_info().rss / 1e6
        self._first_mb = memory if self._first_mb is None else self._first_mb
        offset = self._pipeline.clocks.offset_ns
        return {
            "hours": round(hours, 3),
            "memory_mb": round(memory, 1),
            "grown_mb": round(memory - self._first_mb, 1),
            "threads": self._process.num_threads(),
            "files": self._process.num_fds(),
            "offset_error_ms": None if offset is None else round((arrival_ns(t_ms) / MS - t_ms - offset / MS), 3),
            "valid_percent": round(100 * self.valid / max(self.estimates, 1), 2),
            "rejected": sum(self._pipeline.health(arrival_ns(t_ms)).rejected.values()),
            "times_real_time": round(hours * 3600 / (time.perf_counter() - self._began), 1),
        }


def soak(hours: float, image_ms: int, every: float) -> Iterator[Numbers]:
    """Fly, and yield the figures every `every` simulated hours."""
    pipeline = Pipeline(load_config(None, (f"estimator.leader.size_prior_m={SPAN}",)))
    watch, due = Watch(pipeline), every
    for datagram in flight(hours, image_ms):
        for output in pipeline.feed(datagram):
            watch.count(output)
        flown_ms = (datagram.t_recv_ns - EPOCH) // MS - 5_000
        if flown_ms >= due * 3_600_000:
            yield watch.hour(due, flown_ms + 5_000)
            due += every


def main(arguments: list[str] | None = None) -> int:
    """Fly and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.soak", description="A long flight.")
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--image-ms", type=int, default=40, help="from one image to the next; a multiple of 10")
    parser.add_argument("--every", type=float, default=1.0, help="simulated hours between the figures")
    options = parser.parse_args(arguments)
    for numbers in soak(options.hours, options.image_ms, options.every):
        print(json.dumps(numbers), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())

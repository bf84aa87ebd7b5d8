"""The minimum that a Python program needs for the same bytes, for comparison with the daemon.

    python -m benchmarks.floor --udp 14540 --zenoh tcp/127.0.0.1:7447 --like estimate.json

`benchmarks.live` measures both in the same minutes, so that their ratio does not depend on the computer. This
program reads MAVLink from a UDP socket with asyncio, checks no checksum, unpacks three kinds of messages with
`struct`, and takes images from Zenoh. For each image it predicts, compares and corrects as many hypotheses as the
leader has in steady flight, by the same compiled functions. All other arithmetic, gates, weights, clocks, history,
health and recording are left out. It publishes the given estimate with the image's time, through the daemon's own
Zenoh sink.
"""

import argparse
import asyncio
import struct
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader.config import Config
from onboard.estimators.leader.hypotheses import motion as model
from onboard.estimators.leader.hypotheses import prediction, view
from onboard.estimators.leader.hypotheses.belief import leader_model
from onboard.estimators.leader.image.measurement import measure_wing
from onboard.messages import CameraPoints, Datagram, Estimate

HYPOTHESIS_COUNT: Final = 84
HEADER_BYTES: Final = 10  # MAVLink 2
LAYOUTS: Final = {31: struct.Struct("<I7f"), 32: struct.Struct("<I6f"), 105: struct.Struct("<Q13fH")}
MAX_PAYLOAD_BYTES: Final = 64  # zeros at the end of a payload are not sent
IMAGES: Final = "onboard/1/camera/*/points"
DT: Final = 1.0 / 30.0
NO_ROTATION: Final = np.zeros(3)
NO_BIASES: Final = np.zeros((0, 2))
LEADER: Final = leader_model(Config())
PASSED: Final = prediction.Passed(DT, NO_ROTATION, 0.05, False, 3.0, 0.05, True)
ROWS: Final = measure_wing([(0.0, 0.0), (-0.04, 0.0), (0.04, 0.0)], [1e-3] * 3).rows


class Arithmetic:
    """A prediction and an update of the hypotheses of a leader 25 m in front of us."""

    def __init__(self) -> None:
        rng = np.random.default_rng(1)
        means = 0.1 * rng.normal(size=(HYPOTHESIS_COUNT, model.N))
        means[:, 0] += 25.0
        means[:, model.LOG_SIZE] = 0.7
        P = np.tile(0.01 * np.eye(model.N), (HYPOTHESIS_COUNT, 1, 1))
        drags, zero = np.full(HYPOTHESIS_COUNT, 0.16), np.zeros(HYPOTHESIS_COUNT)
        headings, steady = rng.uniform(-1.0, 1.0, HYPOTHESIS_COUNT), np.zeros((HYPOTHESIS_COUNT, 3))
        self._first = prediction.ParticleArrays(headings, zero, zero, means, P, steady, zero, drags, zero)
        self._weights = np.full(HYPOTHESIS_COUNT, 1.0 / HYPOTHESIS_COUNT)

    def image(self, y: Array) -> Array:
        """Return the NIS (HYPOTHESIS_COUNT,) of a measurement y (4,) of `leader.image.measurement`."""
        particles = prediction.ParticleArrays(*(array.copy() for array in self._first))
        prediction.step(particles, np.log(self._weights), 4, LEADER, NO_BIASES, False, PASSED)
        shown = ROWS.points, ROWS.of, ROWS.shares, ROWS.axis, y, ROWS.R, True, *ROWS.posture
        rows = view.ImageRows(*shown, NO_ROTATION, np.eye(3), 0, particles.course_locked)
        state = particles.means, particles.covariances, particles.headings
        *_, each = view.expect(*state, self._weights, rows)
        nis, _ = view.update(*state, rows, each)
        return np.asarray(nis)


def unpack(frame: bytes) -> tuple[Any, ...] | None:
    """Return the fields of a MAVLink 2 frame, or None for a message that is not needed."""
    layout = LAYOUTS.get(frame[7] | frame[8] << 8 | frame[9] << 16)
    return (
        None
        if layout is None
        else layout.unpack_from(frame[HEADER_BYTES : HEADER_BYTES + frame[1]].ljust(MAX_PAYLOAD_BYTES, b"\0"))
    )


def measurement(image: CameraPoints) -> Array:
    """Return the measurement (4,) of an image in pixels."""
    at, a, b, c = image.intrinsics, image.center, image.left, image.right
    assert at is not None and a is not None and b is not None and c is not None  # noqa: S101, PT018 - of our flight
    half_u, half_v = 0.5 * (c.u_px - b.u_px) / at.fx_px, 0.5 * (c.v_px - b.v_px) / at.fy_px
    return np.array([(a.u_px - at.cx_px) / at.fx_px, (a.v_px - at.cy_px) / at.fy_px, half_u, half_v])


def replay_s(datagrams: Iterable[Datagram]) -> float:
    """Return the seconds of computing for the same datagrams.

    It unpacks MAVLink fields, and computes an image for each three LANDING_TARGETs.
    """
    arithmetic, points = Arithmetic(), 0
    y = np.array([0.0, 0.0, 0.08, 0.0])
    arithmetic.image(y)  # loaded
    began = time.process_time()
    for datagram in datagrams:
        frame = datagram.data
        if frame[0] == 0xFD and frame[7] == 149 and not frame[8]:
            points += 1
            if points % 3 == 0:
                arithmetic.image(y)
        elif frame[0] == 0xFD:
            unpack(frame)
    return time.process_time() - began


class Receiver(asyncio.DatagramProtocol):
    """Stores the newest fields of each kind."""

    def __init__(self) -> None:
        self.newest: dict[int, tuple[Any, ...]] = {}

    def datagram_received(self, data: bytes, _addr: Any) -> None:
        """Unpack one MAVLink frame."""
        fields = unpack(data)
        if fields is not None:
            self.newest[len(fields)] = fields


async def run(udp: int, endpoint: str, like: Estimate) -> None:
    """Run until cancelled.

    A line on standard error says when it listens, and another when it has first published.
    """
    from onboard.sinks import zenoh as publishing  # noqa: PLC0415 - not for a replay
    from onboard.sinks.zenoh_session import ZenohConfig, open_session  # noqa: PLC0415

    loop, arithmetic, decoder = asyncio.get_running_loop(), Arithmetic(), msgspec.json.Decoder(CameraPoints)
    session = await asyncio.to_thread(open_session, ZenohConfig(listen=(endpoint,)))
    sink = publishing.runner(publishing.ZenohSink(session, "onboard/1"))
    arithmetic.image(np.array([0.0, 0.0, 0.08, 0.0]))  # loaded
    await loop.create_datagram_endpoint(Receiver, local_addr=("127.0.0.1", udp))
    said = False

    def on_image(data: bytes) -> None:
        nonlocal said
        image = decoder.decode(data)
        arithmetic.image(measurement(image))
        report = msgspec.structs.replace(like.measurement, t_ns=image.t_ns) if like.measurement else None
        sink.put(msgspec.structs.replace(like, t_ns=image.t_ns, measurement=report))
        if not said:
            print("leader: published", file=sys.stderr, flush=True)
            said = True

    heard: Callable[[Any], None] = lambda sample: _handed(loop, on_image, sample)  # noqa: E731
    declared = session.declare_subscriber(IMAGES, heard)
    print("link autopilot", file=sys.stderr, flush=True)
    try:
        await sink.run()
    finally:
        declared.undeclare()
        await asyncio.to_thread(session.close)


def _handed(loop: asyncio.AbstractEventLoop, on_image: Callable[[bytes], None], sample: Any) -> None:
    loop.call_soon_threadsafe(on_image, sample.payload.to_bytes())


def main() -> int:
    """Run until a signal."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.floor")
    parser.add_argument("--udp", type=int, required=True)
    parser.add_argument("--zenoh", required=True, help="the endpoint to listen on")
    parser.add_argument("--like", type=Path, required=True, help="an estimate in JSON, which it publishes")
    options = parser.parse_args()
    like = msgspec.json.decode(options.like.read_bytes(), type=Estimate)
    asyncio.run(run(options.udp, options.zenoh, like))
    return 0


if __name__ == "__main__":
    sys.exit(main())

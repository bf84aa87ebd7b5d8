"""The common part of the example detectors: simulated pictures in, detections out."""

import argparse
import queue
import statistics
import time
from collections.abc import Callable

import cv2
import msgspec
import numpy as np
import numpy.typing as npt

from onboard.client import Camera
from onboard.messages import Clock, Picture
from onboard.sinks.zenoh_session import ZenohConfig, open_session

REPORT_IMAGES = 100  # between two reports

Point = tuple[float, float, float]
Find = Callable[[npt.NDArray[np.uint8]], dict[str, Point] | None]


def run_detector(find: Find, description: str | None) -> int:
    """Find an aircraft in each picture and send it, until interrupted.

    Only the newest picture waits.
    """
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--connect", default="tcp/127.0.0.1:7447", metavar="ENDPOINT", help="(default: %(default)s)"
    )
    parser.add_argument("--vehicle", default="1", help="(default: %(default)s)")
    given = parser.parse_args()
    newest: queue.Queue[tuple[bytes, float]] = queue.Queue(maxsize=1)

    def on_picture(sample: object) -> None:
        while newest.full():
            try:
                newest.get_nowait()
            except queue.Empty:
                break
        newest.put((sample.payload.to_bytes(), time.monotonic()))  # type: ignore[attr-defined]

    session = open_session(ZenohConfig(vehicle=given.vehicle, mode="client", listen=(), connect=(given.connect,)))
    took_ms: list[float] = []
    try:
        with Camera(endpoint=given.connect, vehicle=given.vehicle, clock=Clock.BOOT) as camera:  # simlink's
            subscriber = session.declare_subscriber(f"simlink/{given.vehicle}/picture", on_picture)
            while True:
                data, arrived = newest.get()
                picture = msgspec.json.decode(data, type=Picture)
                grey = cv2.imdecode(np.frombuffer(picture.jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
                found = None if grey is None else find(np.asarray(grey, np.uint8))
                if found is not None:
                    camera.send(found, t_ns=picture.t_ns, target="leader")
                took_ms.append(1e3 * (time.monotonic() - arrived))
                if len(took_ms) == REPORT_IMAGES:
                    print(
                        f"{REPORT_IMAGES} pictures, from arrival to detection {statistics.median(took_ms):.1f} ms",
                        flush=True,
                    )
                    took_ms.clear()
    except KeyboardInterrupt:
        return 0
    finally:
        del subscriber
        session.close()

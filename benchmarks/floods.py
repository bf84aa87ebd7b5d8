"""Floods, each from its own sender, at a daemon that also follows a good leader.

    python -m benchmarks.floods --udp 14540 --seconds 20 --begin-ns 123 --kind imu=10000 --kind adsb=10000

The kinds are `imu`, samples of the autopilot's own in single datagrams; `adsb`, reports of 10,000 aircraft;
`param_set` and `param_list`, by a ground station; `garbage`, bytes that are no frame; `unsigned`, heartbeats of
the autopilot's number without a key; `points`, images of unknown cameras and targets, over Zenoh. With --key, all
but `garbage` and `unsigned` are signed: their sender holds the key. It prints, as JSON, how many of each were
sent.
"""

import argparse
import json
import socket
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from itertools import cycle
from typing import Any, Final

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from benchmarks.live_flight import START_TIME_MS, client, imu
from benchmarks.targets import MS
from onboard.wire.mavlink.encode import MavlinkEncoder
from onboard.wire.mavlink.signing import Signer

KINDS: Final = ("imu", "adsb", "param_set", "param_list", "garbage", "unsigned", "points")
AIRCRAFT_COUNT: Final = 10_000
STRANGER_COUNT: Final = 100  # cameras of points, and as many targets
BURST_PERIOD_S: Final = 0.001
MAX_DELAY_S: Final = 0.01
SENDERS: Final = {  # system and component
    "adsb": (1, 1),
    "unsigned": (1, 1),
    "param_set": (255, 190),
    "param_list": (255, 190),
}
Make = Callable[[], bytes]


def maker(kind: str, begin_ns: int) -> Make:
    """Return a function that makes the next datagram of a kind.

    `begin_ns` is the begin of the flight on the monotonic clock.
    """
    if kind == "imu":
        own = MavlinkEncoder(1, 1)
        return lambda: own.encode(imu(START_TIME_MS * MS + max(0, time.monotonic_ns() - begin_ns)))
    if kind == "garbage":
        rng = np.random.default_rng(1)
        pieces = cycle([rng.bytes(60) for _ in range(1000)])
        return lambda: next(pieces)
    system, component = SENDERS[kind]
    packer = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
    messages = cycle(list(_messages(kind)))

    def pack() -> bytes:
        packer.seq = (packer.seq + 1) % 256
        return bytes(next(messages).pack(packer))

    return pack


def _messages(kind: str) -> Iterator[Any]:
    if kind == "adsb":
        for k in range(AIRCRAFT_COUNT):
            lat, lon = round(47e7 + 3e3 * (k % 100)), round(8e7 + 3e3 * (k // 100))
            yield dialect.MAVLink_adsb_vehicle_message(
                1 + k, lat, lon, 0, 500_000, 9000, 5000, 0, b"FLOOD", 1, 0, 0b111_1111, 0
            )
    elif kind == "unsigned":
        yield dialect.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3)
    elif kind == "param_set":
        for k in range(100):
            yield dialect.MAVLink_param_set_message(1, 191, b"CAM_SIGMA_PX", 1.0 + 0.01 * k, 9)
    else:
        yield dialect.MAVLink_param_request_list_message(1, 191)


def run(rates: Mapping[str, int], options: argparse.Namespace) -> dict[str, int]:
    """Send all kinds at their rates; return how many of each were sent.

    A delay of more than `MAX_DELAY_S` is not made up for: it would come in one burst.
    """
    signer = Signer(bytes.fromhex(options.key), 3) if options.key else None
    sockets, makers = {}, {}
    for kind in rates:
        if kind != "points":
            sockets[kind] = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            sockets[kind].connect(("127.0.0.1", options.udp))
            makers[kind] = maker(kind, options.begin_ns)
    session = client(options.zenoh) if "points" in rates else None
    sent, due = dict.fromkeys(rates, 0), dict.fromkeys(rates, 0.0)
    last = begin = time.monotonic()
    while (now := time.monotonic()) - begin < options.seconds:
        passed, last = min(now - last, MAX_DELAY_S), now
        for kind, rate in rates.items():
            due[kind] += passed * rate
            for _ in range(int(due[kind]) - sent[kind]):
                sent[kind] += 1
                if session is not None and kind == "points":
                    session.put(*_points(sent[kind], options.begin_ns))
                    continue
                data = makers[kind]()
                if signer is not None and kind not in {"garbage", "unsigned"}:
                    data = signer.sign(data, time.time_ns())
                with suppress(OSError):  # no room
                    sockets[kind].send(data)
        time.sleep(BURST_PERIOD_S)
    if session is not None:
        session.close()
    return sent


def _points(k: int, begin_ns: int) -> tuple[str, bytes]:
    """Return key and image of an unknown camera, or every other time of our camera and an unknown target."""
    camera = "front" if k % 2 else f"stranger{k % STRANGER_COUNT}"
    pixels = {name: {"u_px": u, "v_px": 240.0} for name, u in (("center", 320), ("left", 300), ("right", 340))}
    image = {
        "t_ns": START_TIME_MS * MS + max(0, time.monotonic_ns() - begin_ns),
        "clock": "boot",
        "camera": camera,
        "intrinsics": {"fx_px": 554.0, "fy_px": 554.0, "cx_px": 320.0, "cy_px": 240.0},
        "target": f"stranger/{k % STRANGER_COUNT}",
        **pixels,
    }
    return f"onboard/1/camera/{camera}/points", json.dumps(image).encode()


def main() -> int:
    """Send, and print the counts."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.floods")
    parser.add_argument("--udp", type=int, required=True)
    parser.add_argument("--zenoh", help="the daemon's endpoint, for points")
    parser.add_argument("--seconds", type=int, default=10)
    parser.add_argument("--begin-ns", type=int, default=0)
    parser.add_argument("--key", default="", help="64 hexadecimal digits")
    parser.add_argument("--kind", action="append", metavar="KIND=RATE", required=True)
    options = parser.parse_args()
    rates = {kind: int(rate) for kind, _, rate in (one.partition("=") for one in options.kind)}
    print(json.dumps(run(rates, options)))
    return 0


if __name__ == "__main__":
    sys.exit(main())

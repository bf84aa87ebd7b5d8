"""The bytes of a flight as a daemon receives them, sent in real time by its own process.

    python -m benchmarks.live_flight --udp 14540 --zenoh tcp/127.0.0.1:7447 --seconds 30

It sends 200 samples of the IMU a second, 50 of attitude and position, and 30 images that arrive 40 ms after their
exposure. --heartbeats sends one every 20 ms, for a start that need not wait for one. --origin sends the origin on
the Earth, for reports of other aircraft. --key signs. --flood sends that many samples of the IMU a second instead.
It prints, as JSON, when each image was sent, by its stamp, and how many datagrams were sent.
"""

import argparse
import json
import socket
import sys
import time
from contextlib import suppress
from typing import Any, Final

import msgspec

from benchmarks.targets import EPOCH, LATE_MS, MS, flight
from onboard.messages import Datagram, Encoding, GlobalOrigin, Heartbeat, Imu
from onboard.wire.documents.points import decode_points
from onboard.wire.mavlink.encode import MavlinkEncoder
from onboard.wire.mavlink.signing import Signer

IMU_PERIOD_MS: Final = 5
HEARTBEAT_PERIOD_MS: Final = 20
START_TIME_MS: Final = 5_000  # of the boot clock
BURST_PERIOD_S: Final = 0.001
KEY: Final = "onboard/1/camera/front/points"


def datagrams(seconds: int, *, heartbeats: bool = False, origin: bool = False) -> list[Datagram]:
    """Return one leader's flight, in order of arrival.

    `heartbeats` adds one every 20 ms, `origin` one a second.
    """
    encoder, end_ms = MavlinkEncoder(1, 1), START_TIME_MS + 1000 * seconds
    found = [_of_leader(datagram) for datagram in flight(1, seconds)]
    found.extend(_mavlink(encoder, imu(t_ms * MS), t_ms) for t_ms in range(START_TIME_MS, end_ms, IMU_PERIOD_MS))
    if heartbeats:
        found.extend(
            _mavlink(encoder, _heartbeat(t_ms), t_ms) for t_ms in range(START_TIME_MS, end_ms, HEARTBEAT_PERIOD_MS)
        )
    if origin:
        found.extend(_mavlink(encoder, _origin(t_ms), t_ms) for t_ms in range(START_TIME_MS, end_ms, 1000))
    return sorted(found, key=lambda datagram: datagram.t_recv_ns)


def _of_leader(datagram: Datagram) -> Datagram:
    data = datagram.data.replace(b'"target/0"', b'"leader"')
    return msgspec.structs.replace(datagram, data=data)


def imu(t_ns: int) -> Imu:
    """Return a sample of the IMU at a boot time."""
    return Imu(t_ns=t_ns, t_recv_ns=EPOCH + t_ns, f_b=(0.0, 0.0, -9.81), omega_b=(0.0, 0.0, 0.01))


def _origin(t_ms: int) -> GlobalOrigin:
    stamp: dict[str, Any] = {"t_ns": t_ms * MS, "t_recv_ns": EPOCH + t_ms * MS}
    return GlobalOrigin(**stamp, lat_deg=47.0, lon_deg=8.0, alt_msl=400.0)


def _heartbeat(t_ms: int) -> Heartbeat:
    stamp: dict[str, Any] = {"t_ns": t_ms * MS, "t_recv_ns": EPOCH + t_ms * MS}
    return Heartbeat(**stamp, vehicle_type=2, autopilot=12, armed=True, status=4)


def _mavlink(encoder: MavlinkEncoder, message: Any, t_ms: int) -> Datagram:
    data = encoder.encode(message)
    return Datagram(channel="mavlink", encoding=Encoding.MAVLINK, t_recv_ns=EPOCH + t_ms * MS + MS, data=data)


def as_mavlink(datagram: Datagram, encoder: MavlinkEncoder) -> bytes:
    """Return camera points as LANDING_TARGETs, for a camera that needs no Zenoh."""
    (points,) = decode_points(datagram.data, datagram.t_recv_ns).detections
    return encoder.encode(points)


def send(
    flown: list[Datagram], to: socket.socket, publisher: Any | None, *, begin_ns: int = 0, key: str = ""
) -> dict[str, Any]:
    """Send each datagram at its time, from `begin_ns` of the monotonic clock or now.

    `key` (64 hexadecimal digits) signs. Without a publisher, images are sent as MAVLink.
    """
    encoder, signer = MavlinkEncoder(1, 191), Signer(bytes.fromhex(key), 1) if key else None
    sent: list[tuple[int, int, int]] = []  # stamp, exposure and sending on the monotonic clock, ns
    begin_ns = (begin_ns or time.monotonic_ns() + 50 * MS) - flown[0].t_recv_ns
    for datagram in flown:
        time.sleep(max(0.0, (begin_ns + datagram.t_recv_ns - time.monotonic_ns()) * 1e-9))
        if datagram.encoding is Encoding.MAVLINK:
            _put(to, datagram.data if signer is None else signer.sign(datagram.data, time.time_ns()))
            continue
        exposed_ns = datagram.t_recv_ns - LATE_MS * MS
        sent.append((exposed_ns - EPOCH, begin_ns + exposed_ns, time.monotonic_ns()))
        if publisher is not None:
            publisher.put(datagram.data)
        else:
            _put(to, as_mavlink(datagram, encoder))
    return {"images": sent, "datagrams": len(flown)}


def flood(rate: int, seconds: float, to: socket.socket) -> dict[str, Any]:
    """Send samples of the IMU at a rate, in bursts each millisecond, and make up for late bursts."""
    encoder = MavlinkEncoder(1, 1)
    frames = [encoder.encode(imu((START_TIME_MS + k) * MS)) for k in range(1000)]
    begin = time.monotonic()
    count = 0
    while (now := time.monotonic() - begin) < seconds:
        for _ in range(int(now * rate) - count):
            _put(to, frames[count % 1000])
            count += 1
        time.sleep(BURST_PERIOD_S)
    return {"datagrams": count, "rate": count / (time.monotonic() - begin)}


def _put(to: socket.socket, data: bytes) -> None:
    with suppress(OSError):  # nobody listens yet, or there is no room: a datagram may be lost
        to.send(data)


def main() -> int:
    """Send, and print the counts."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.live_flight")
    parser.add_argument("--udp", type=int, required=True, help="the port of `udpin` on the loopback interface")
    parser.add_argument("--zenoh", help="the daemon's endpoint; without it, images go as MAVLink")
    parser.add_argument("--seconds", type=int, default=10)
    parser.add_argument("--heartbeats", action="store_true", help="one every 20 ms")
    parser.add_argument("--origin", action="store_true", help="one a second")
    parser.add_argument("--key", default="", help="sign MAVLink with it: 64 hexadecimal digits")
    parser.add_argument("--begin-ns", type=int, default=0, help="on the monotonic clock; by default now")
    parser.add_argument("--flood", type=int, help="messages a second")
    options = parser.parse_args()
    to = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    to.connect(("127.0.0.1", options.udp))
    if options.flood:
        made = flood(options.flood, options.seconds, to)
    elif options.zenoh:
        with client(options.zenoh) as session:
            publisher = session.declare_publisher(KEY, express=True)
            flown = datagrams(options.seconds, origin=options.origin)
            made = send(flown, to, publisher, begin_ns=options.begin_ns, key=options.key)
    else:
        made = send(datagrams(options.seconds, heartbeats=options.heartbeats), to, None)
    print(json.dumps(made))
    return 0


def client(endpoint: str) -> Any:
    """Open a Zenoh session as a client of an endpoint."""
    import zenoh  # noqa: PLC0415 - not for floods

    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    return zenoh.open(config)


if __name__ == "__main__":
    sys.exit(main())

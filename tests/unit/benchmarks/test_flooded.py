"""Floods beside a leader: that they are what they are called, and that what they cost is counted; how much, the
benchmark says."""

import time
from collections import Counter

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from benchmarks import flooded, floods
from onboard.messages import Datagram, Encoding
from onboard.wire.datagrams import DatagramDecoder

NAMES = {
    "imu": {"HIGHRES_IMU"},
    "adsb": {"ADSB_VEHICLE"},
    "param_set": {"PARAM_SET"},
    "param_list": {"PARAM_REQUEST_LIST"},
    "unsigned": {"HEARTBEAT"},
}


@pytest.mark.parametrize("kind", NAMES)
def test_each_flood_is_of_whole_frames_of_its_kind(kind: str) -> None:
    make = floods.maker(kind, time.monotonic_ns())
    frames = [make() for _ in range(200)]
    found = dialect.MAVLink(None).parse_buffer(b"".join(frames))
    assert {m.get_type() for m in found} == NAMES[kind]
    assert len(found) == len(frames)
    if kind == "adsb":
        assert len({m.ICAO_address for m in found}) == len(frames)


def test_garbage_is_no_frame_and_strangers_points_are_documents() -> None:
    make, decoder = floods.maker("garbage", 0), DatagramDecoder()
    for data in (make() for _ in range(200)):
        datagram = Datagram(channel="a", encoding=Encoding.MAVLINK, t_recv_ns=1, data=data)
        assert decoder.decode(datagram) == []
    keys = Counter()
    for k in range(200):
        key, data = floods._points(k, time.monotonic_ns())
        (message,) = decoder.decode(Datagram(channel=key, encoding=Encoding.POINTS, t_recv_ns=1, data=data))
        keys[message.camera] += 1  # type: ignore[attr-defined]
    assert keys["front"] == 100
    assert len(keys) == 1 + floods.STRANGER_COUNT // 2
    assert set(flooded.ALL) == set(floods.KINDS)


@pytest.mark.slow
def test_a_leader_in_all_floods_is_measured_and_what_is_left_out_is_counted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(flooded, "SETTLING_TIME_S", 2)
    monkeypatch.setattr(flooded, "TAIL_TIME_S", 1)
    found = flooded.measure_flood("strangers", 3)
    assert found["images"] == 60
    assert found["answered"] > 0
    assert all(found["sent"].values())
    assert found["left_out"]["unsigned"] > 100
    (said,) = [line for line in found["lines"] if "frames are not signed" in line]
    assert found["lines"][said] == 1

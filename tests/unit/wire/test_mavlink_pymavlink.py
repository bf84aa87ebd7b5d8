"""Our decoder beside pymavlink's parser: the same records from the same bytes, the same counts of the others."""

import struct
from collections.abc import Iterable
from itertools import pairwise

import numpy as np
import pytest
from msgspec.structs import astuple, replace
from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.messages import Attitude, Barometer, Encoding, Exposure, GimbalAttitude, Message
from onboard.wire.logs.recording import read_recording
from onboard.wire.logs.tlog import read_tlog
from onboard.wire.mavlink.decode import MavlinkDecoder
from onboard.wire.mavlink.landing_target import LANDING_TARGET
from onboard.wire.mavlink.records import CONVERT
from tests.support.mavlink_frames import RECEIVE_TIME_NS, crc_x25, frame
from tests.support.programs import ROOT
from tests.support.pymavlink_reference import Reference

DATA = ROOT.parent / "shared" / "data"
TLOGS = ("formation-copter/follower.tlog", "target-out-of-view/follower.tlog", "hover-collapse/fresh-noise.tlog")
OF_IMAGES = {"incomplete_points", "landing_target_position"}
ATTITUDES = (Attitude, GimbalAttitude)
KINDS = {kind.msgname: kind for kind in dialect.mavlink_map.values()}
LAYOUTS = {name: layout for name, (layout, _) in CONVERT.items() if name in KINDS} | {
    "LANDING_TARGET": LANDING_TARGET
}


def comparable(messages: Iterable[Message]) -> list[str]:
    """Records as text that is the same for the same bits, NaN included, but for what `computed` lists. Images are
    ours alone."""
    return [repr((type(m).__name__, *astuple(_plain(m)))) for m in messages if not isinstance(m, Exposure)]


def _plain(m: Message) -> Message:
    if isinstance(m, Barometer):
        return replace(m, pressure_altitude=0.0)
    if isinstance(m, Attitude):
        return replace(m, q_nb=(1.0, 0.0, 0.0, 0.0))
    return replace(m, mount=replace(m.mount, q=(1.0, 0.0, 0.0, 0.0))) if isinstance(m, GimbalAttitude) else m


def computed(messages: Iterable[Message]) -> tuple[list[float], list[float]]:
    """Altitudes and quaternions: those that the decoder computes differ from pymavlink's by rounding, and by the
    digits of a constant."""
    heard = list(messages)
    quaternions = [m.q_nb if isinstance(m, Attitude) else m.mount.q for m in heard if isinstance(m, ATTITUDES)]
    return [m.pressure_altitude for m in heard if isinstance(m, Barometer)], [x for q in quaternions for x in q]


def assert_same(pieces: Iterable[bytes], *, stream: bool) -> MavlinkDecoder:
    ours, reference = MavlinkDecoder(stream=stream), Reference(stream=stream)
    all_found: list[Message] = []
    all_expected: list[Message] = []
    for piece in pieces:
        found, expected = ours.decode(piece, RECEIVE_TIME_NS), reference.decode(piece, RECEIVE_TIME_NS)
        assert comparable(found) == comparable(expected)
        all_found += found
        all_expected += expected
    (altitudes, quaternions), (their_altitudes, their_quaternions) = computed(all_found), computed(all_expected)
    np.testing.assert_allclose(altitudes, their_altitudes, rtol=1e-4)
    np.testing.assert_allclose(quaternions, their_quaternions, rtol=1e-9, atol=1e-12)
    assert ours.names == reference.names
    assert {k: n for k, n in ours.rejected.items() if k not in OF_IMAGES} == reference.rejected
    return ours


def assert_no_less(pieces: Iterable[bytes], *, stream: bool) -> MavlinkDecoder:
    """Of damaged bytes: all that pymavlink reads, in its order, and what it skips with a wrong length."""
    ours, reference = MavlinkDecoder(stream=stream), Reference(stream=stream)
    found: list[str] = []
    expected: list[str] = []
    for piece in pieces:
        found += comparable(ours.decode(piece, RECEIVE_TIME_NS))
        expected += comparable(reference.decode(piece, RECEIVE_TIME_NS))
    rest = iter(found)
    assert all(message in rest for message in expected)
    assert ours.names >= reference.names
    return ours


@pytest.mark.parametrize("name", LAYOUTS)
def test_every_message_that_we_read_at_every_length_with_seed_3(name: str) -> None:
    """Random fields and extensions, payloads cut at each byte (and so extended by zeros), or with bytes of a newer
    sender behind, in both versions."""
    rng = np.random.default_rng([3, KINDS[name].id])
    kind, pieces = KINDS[name], []
    size = kind.unpacker.size
    for length in [*range(1, size + 1), size + 1, 255, *[size] * 20]:
        payload = rng.integers(0, 256, length, dtype=np.uint8).tobytes()
        versions = (1, 2) if kind.id < 256 else (2,)
        pieces += [frame(kind.id, kind.crc_extra, payload, version=v, system=7, component=9) for v in versions]
    pieces += [frame(kind.id, kind.crc_extra, bytes([fill]) * size) for fill in (0, 1, 127, 255)]
    ours = assert_same(pieces, stream=False)
    assert ours.names[name] == len(pieces)


def test_bad_checksums_and_flags_and_cut_frames_with_seed_4() -> None:
    rng = np.random.default_rng(4)
    pieces = []
    for kind in dialect.mavlink_map.values():
        payload = rng.integers(0, 256, kind.unpacker.size, dtype=np.uint8).tobytes()
        good = frame(kind.id, kind.crc_extra, payload)
        pieces += [good, good[:-1] + bytes([good[-1] ^ 1]), good[:-2] + bytes([good[-2] ^ 128]) + good[-1:]]
        flagged, at = bytearray(good), int(rng.integers(3, len(good)))
        flagged[2] = int(rng.integers(0, 256))
        pieces += [bytes(flagged), good[:at], good[at:], bytes(rng.permutation(list(good)).tolist())]
    pieces += [frame(number, 17, payload) for number in range(60_000, 60_011)]
    ours = assert_no_less(pieces, stream=False)
    assert min(ours.rejected[r] for r in ("bad_frame", "unknown_message", "truncated")) > 10
    assert sum(ours.names.values()) >= len(KINDS)


def test_streams_of_frames_and_rubbish_cut_anywhere_with_seed_5() -> None:
    rng = np.random.default_rng(5)
    kinds = [*KINDS.values()]
    data = b""
    for i in rng.integers(0, len(kinds), 600):
        payload = rng.integers(0, 256, kinds[i].unpacker.size, dtype=np.uint8).tobytes()
        data += frame(kinds[i].id, kinds[i].crc_extra, payload)
        if rng.random() < 0.1:
            data += rng.choice([0xFD, 0xFE, 0, 1, 2, 77], int(rng.integers(1, 40))).astype(np.uint8).tobytes()
    cuts = [0, *sorted(rng.integers(0, len(data), 900).tolist()), len(data)]
    pieces = [data[a:b] for a, b in pairwise(cuts)]
    ours = assert_no_less([*pieces, bytes(300)], stream=True)  # no frame waits behind a false start any more
    assert ours.rejected["bad_frame"] > 20
    assert sum(ours.names.values()) >= 599  # rubbish may look like an unknown frame before another one's start


def test_signed_frames_keep_their_length() -> None:
    """A signature of 13 bytes follows the checksum, which does not cover it."""
    payload = struct.pack("<I6f", 1000, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    head = struct.pack("<6B", len(payload), 1, 0, 0, 1, 1) + (32).to_bytes(3, "little")
    checksum = struct.pack("<H", crc_x25(head + payload + bytes([185])))
    signed = b"\xfd" + head + payload + checksum + b"\xfd" * 13
    ours = assert_same([signed + signed, signed[:-1], signed + b"\xfe"], stream=False)
    assert ours.names == {"LOCAL_POSITION_NED": 3}


@pytest.mark.slow  # half a minute
@pytest.mark.parametrize("log", [*TLOGS, "logs/dronekit_flight.tlog"])
def test_every_frame_of_recorded_flights(log: str) -> None:
    path = DATA / log
    if not path.exists():
        pytest.skip("the recorded flights are not here")
    datagrams = [item for item, _ in read_tlog(path.read_bytes()) if item is not None]
    ours = assert_same([d.data for d in datagrams], stream=False)
    assert sum(ours.names.values()) > 9000


@pytest.mark.slow
def test_every_frame_of_our_own_recording() -> None:
    path = DATA / "hover-collapse" / "hover_collapse.mcap"
    if not path.exists():
        pytest.skip("the recorded flights are not here")
    datagrams = [item for item, _ in read_recording(path) if item is not None]
    pieces = [d.data for d in datagrams if d.encoding is Encoding.MAVLINK_STREAM]
    assert sum(assert_same(pieces, stream=True).names.values()) > 9000


@pytest.mark.slow
def test_a_recorded_flight_as_one_stream() -> None:
    path = DATA / TLOGS[2]
    if not path.exists():
        pytest.skip("the recorded flights are not here")
    data = b"".join(item.data for item, _ in read_tlog(path.read_bytes()) if item is not None)
    ours = assert_same([data[i : i + 1000] for i in range(0, len(data), 1000)], stream=True)
    assert sum(ours.names.values()) > 9000

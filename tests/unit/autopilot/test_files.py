"""Our parameters' metadata as pymavlink's client of MAVLink FTP lists and reads it, and what it cannot do."""

import json
import struct
import time
from collections import deque
from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink import mavftp
from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.autopilot.files import MOST_IN_BURST, Files
from onboard.autopilot.metadata import DESCRIPTIONS, Metadata
from onboard.autopilot.parameters import KEYS, Parameters
from onboard.config import load_config
from onboard.messages import Clock, FileError, FileReply, FileRequest
from onboard.wire.mavlink.decode import MavlinkDecoder
from onboard.wire.mavlink.files import crc32
from tests.support.emitted import LINK, NOW, command, everything

LONG = bytes(range(256)) * 20  # more than one burst carries
WRITING = (6, 7, 8, 9, 10, 11, 12, 13)  # create, write, remove, and the like: opcodes that we do not have


def request(
    opcode: int, data: bytes = b"", offset: int = 0, size: int | None = None, **changed: int
) -> FileRequest:
    ids = {
        "system": 255,
        "component": 190,
        "target_system": 7,
        "target_component": 191,
        "number": 41,
        "session": 0,
    }
    return FileRequest(
        t_ns=NOW,
        t_recv_ns=NOW,
        clock=Clock.NONE,
        opcode=opcode,
        size=len(data) if size is None else size,
        offset=offset,
        data=data,
        **ids | changed,
    )


class Folder(Files):
    """Two files."""

    def __init__(self) -> None:
        super().__init__({"a": b"aaa", "b.txt": LONG})

    def one(self, *args: Any, **kwargs: Any) -> FileReply:
        """The only answer to a request."""
        (reply,) = self.answer(request(*args, **kwargs), NOW)
        return reply


class Link:
    """A connection of pymavlink's to our output: what is sent is answered at once."""

    source_system, source_component = 255, 190

    def __init__(self, lost: set[int]) -> None:
        self._output, self._lost, self._sent = everything(), lost, 0
        self._received: deque[Any] = deque()
        self._mav, self._parser = dialect.MAVLink(None, srcSystem=255, srcComponent=190), dialect.MAVLink(None)
        self.mav = SimpleNamespace(file_transfer_protocol_send=self._send)

    def _send(self, network: int, system: int, component: int, payload: bytes) -> None:
        message = dialect.MAVLink_file_transfer_protocol_message(network, system, component, payload)
        messages = MavlinkDecoder(stream=False).decode(message.pack(self._mav), NOW)
        for frame in self._output.respond(LINK, messages, NOW).frames:
            self._sent += 1
            if self._sent not in self._lost:
                self._received.extend(self._parser.parse_buffer(frame))

    def recv_match(self, **_: Any) -> Any:
        if self._received:
            return self._received.popleft()
        time.sleep(0.01)  # the client asks again by its own clock
        return None


@pytest.mark.parametrize("lost", [set(), {4, 7}])
def test_pymavlink_reads_the_metadata_of_all_parameters(lost: set[int]) -> None:
    client = mavftp.MAVFTP(Link(lost), target_system=7, target_component=191)
    settings = client.ftp_settings
    settings.idle_detection_time, settings.retry_time, settings.read_retry_time = 0.2, 0.15, 0.1
    received: list[bytes] = []
    client.cmd_get(["parameters.json"], callback=lambda file: received.append(file.read()))
    client.process_ftp_reply("OpenFileRO", timeout=20)
    described = json.loads(received[0])["parameters"]
    assert [p["name"] for p in described] == list(DESCRIPTIONS)
    assert described[0] == {
        "name": "LDR_SIZE_M",
        "type": "Float",
        "group": "Leader",
        "shortDesc": "size, between the two outer points",
        "longDesc": "estimator.leader.size_prior_m of the configuration. A value holds from the next start on.",
        "units": "m",
        "rebootRequired": True,
    }


def test_each_parameter_has_its_metadata() -> None:
    assert list(DESCRIPTIONS) == list(KEYS)
    without = Parameters(load_config(None, ("estimator={}",))).names
    files = Metadata(without, 191).files
    described = json.loads(files["parameters.json"])["parameters"]
    assert [(p["name"], p["units"]) for p in described][-1] == ("CAM_DELAY_S", "s")
    assert [p["name"] for p in described] == list(without)
    (where,) = json.loads(files["general.json"])["metadataTypes"]
    assert where == {
        "type": 1,
        "uri": "mftp://[;comp=191]parameters.json",
        "fileCrc": crc32(files["parameters.json"]),
    }


def test_component_metadata_by_hand() -> None:
    """Its definition in the order of the wire: time_boot_ms, file_crc, uri; 397, CRC_EXTRA 182."""
    _, frame = everything().respond(LINK, [command("COMPONENT_METADATA", 512)], NOW).frames
    assert int.from_bytes(frame[7:10], "little") == 397
    _, crc, uri = struct.unpack("<2I100s", frame[10:-2].ljust(108, b"\0"))
    assert uri.rstrip(b"\0") == b"mftp://[;comp=191]general.json"
    assert crc == crc32(Metadata(KEYS, 191).files["general.json"])
    checked = dialect.x25crc(frame[1:-2])
    checked.accumulate(bytes([182]))
    assert checked.crc == int.from_bytes(frame[-2:], "little")


def test_the_crc_is_that_of_the_protocol() -> None:
    """Bit by bit: the polynomial 0xEDB88320, from 0, with nothing inverted."""
    crc = 0
    for byte in LONG:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xEDB88320 if crc & 1 else 0)
    assert Folder().one(14, b"b.txt").data == struct.pack("<I", crc)


def test_a_file_is_opened_listed_and_read_from_any_place() -> None:
    folder = Folder()
    opened = folder.one(4, b"/b.txt\0")
    assert (opened.session, opened.number, opened.data) == (0, 42, struct.pack("<I", len(LONG)))
    assert folder.one(3, b"/").data == b"Fa\t3\0Fb.txt\t5120\0"
    assert folder.one(3, b"/", offset=1).data == b"Fb.txt\t5120\0"
    read = folder.one(5, offset=5000, size=239)
    assert (read.offset, read.data) == (5000, LONG[5000:])
    assert folder.one(5, size=255).data == LONG[:239]
    assert folder.one(0).error is None


@pytest.mark.parametrize("opcode", [1, 2])
def test_each_client_has_a_session_of_its_own_until_it_ends_it(opcode: int) -> None:
    folder = Folder()
    folder.one(4, b"b.txt")
    folder.one(4, b"a", system=254)
    assert (folder.one(5, size=9).data, folder.one(5, size=9, system=254).data) == (LONG[:9], b"aaa")
    assert folder.one(opcode).error is None
    assert folder.one(5, size=9).error is FileError.INVALID_SESSION
    assert folder.one(5, size=9, system=254).data == b"aaa"
    for component in range(16):
        folder.one(4, b"a", component=component)
    assert folder.one(5, size=9, component=0).data == b"aaa"
    assert folder.one(5, size=9, system=254).error is FileError.INVALID_SESSION


def test_a_burst_ends_after_ten_and_at_the_end() -> None:
    folder = Folder()
    folder.one(4, b"b.txt")
    first = folder.answer(request(15, size=100), NOW)
    assert len(first) == MOST_IN_BURST == 10
    assert b"".join(r.data for r in first) == LONG[:1000]
    assert [r.number for r in first] == [*range(42, 52)]
    assert [r.offset for r in first] == [*range(0, 1000, 100)]
    assert [r.is_last for r in first] == [False] * 9 + [True]
    last = folder.one(15, offset=5050, size=100)
    assert (last.data, last.is_last) == (LONG[5050:], True)


@pytest.mark.parametrize(
    ("asked", "error"),
    [
        *[(request(opcode, b"a"), FileError.UNKNOWN_COMMAND) for opcode in WRITING],
        (request(4, b"c"), FileError.NOT_FOUND),
        (request(4, b"../a"), FileError.NOT_FOUND),
        (request(14, b""), FileError.NOT_FOUND),
        (request(3, b"/etc"), FileError.NOT_FOUND),
        (request(3, b"/", offset=2), FileError.END_OF_FILE),
        (request(5, session=2, size=10), FileError.INVALID_SESSION),
        (request(15, session=2, size=10), FileError.INVALID_SESSION),
        (request(15, system=1, size=10), FileError.INVALID_SESSION),
        (request(5, offset=3, size=10), FileError.END_OF_FILE),
        (request(15, offset=2**32 - 1, size=10), FileError.END_OF_FILE),
    ],
)
def test_what_cannot_be_is_refused_with_its_reason(asked: FileRequest, error: FileError) -> None:
    folder = Folder()
    folder.one(4, b"a")
    (reply,) = folder.answer(asked, NOW)
    assert (reply.error, reply.opcode, reply.data) == (error, asked.opcode, b"")


def test_a_file_is_not_asked_of_all_components() -> None:
    """Each has files of its own."""
    out = everything()
    assert len(out.respond(LINK, [request(4, b"general.json")], NOW).frames) == 1
    assert out.respond(LINK, [request(4, b"general.json", target_component=0)], NOW).frames == []

"""Signatures against pymavlink's, and what must neither enter nor block."""

import hashlib
import os
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.autopilot.leader_messages import CameraView, target_relative
from onboard.autopilot.output import AutopilotOutput
from onboard.config import Config, ConfigError, LinkConfig, signing_key
from onboard.geometry.camera import make_camera
from onboard.messages import Datagram, Encoding
from onboard.pipeline import Pipeline
from onboard.wire.mavlink.decode import MavlinkDecoder
from onboard.wire.mavlink.encode import MavlinkEncoder
from onboard.wire.mavlink.signing import Signer, Verifier, read_key
from tests.support.leader import AUTOPILOT, leader_state
from tests.support.mavlink_records import RECORDS

KEY = bytes(range(32))
NOW = 1_800_000_000 * 10**9
EPOCH = datetime(2015, 1, 1, tzinfo=UTC)  # of MAVLink's signatures, whose unit is 10 us
STAMP = (NOW // 10**9 - int(EPOCH.timestamp())) * 100_000


def signed_by_pymavlink(stamp: int, key: bytes = KEY, system: int = 7, status: int = 4) -> bytes:
    """A signed heartbeat."""
    mav = dialect.MAVLink(None, srcSystem=system, srcComponent=1)
    mav.signing.secret_key, mav.signing.link_id, mav.signing.timestamp = key, 3, stamp
    mav.signing.sign_outgoing = True
    return bytes(dialect.MAVLink_heartbeat_message(2, 3, 0, 0, status, 3).pack(mav))


class Receiver:
    """A decoder with the key."""

    def __init__(self, *, stream: bool = False) -> None:
        self.decoder = MavlinkDecoder(stream=stream, verifier=Verifier(KEY))

    def accepts(self, frame: bytes) -> bool:
        """Whether the frame gives a message."""
        return bool(self.decoder.decode(frame, NOW))


@pytest.mark.parametrize("record", RECORDS, ids=lambda r: r[1])
def test_what_we_sign_pymavlink_verifies(record: Any) -> None:
    parser = dialect.MAVLink(None)
    parser.signing.secret_key = KEY
    parser.signing.timestamp = STAMP
    signer, encoder = Signer(KEY, 5), MavlinkEncoder(7, 191)
    for _ in range(2):  # at one time: stamps rise nevertheless
        (m,) = parser.parse_buffer(signer.sign(encoder.encode(record[0]), NOW))
        assert (m.get_type(), m.get_signed()) == (record[1], True)
    other = dialect.MAVLink(None)
    other.signing.secret_key = bytes(32)
    with pytest.raises(dialect.MAVError):
        other.parse_buffer(signer.sign(encoder.encode(record[0]), NOW))


def test_a_message_that_pymavlink_does_not_know_is_signed_too() -> None:
    view = CameraView((1.0, 0.0, 0.0, 0.0), make_camera(f_px=1.0, width_px=1.0, height_px=1.0), is_px4=False)
    message = target_relative(leader_state(), view)
    assert message is not None
    plain = MavlinkEncoder(7, 191).encode(message)
    frame = Signer(KEY, 0).sign(plain, NOW)
    assert len(frame) == len(plain) + 13
    assert Verifier(KEY).check(frame, NOW) == ""


@pytest.mark.parametrize("stream", [False, True])
def test_what_pymavlink_signs_enters_and_nothing_else_does(stream: bool) -> None:
    receiver = Receiver(stream=stream)
    good = signed_by_pymavlink(STAMP)
    forged = good[:-1] + bytes([good[-1] ^ 1])
    assert receiver.accepts(good)
    for bad in (
        good,  # replayed
        forged,
        signed_by_pymavlink(STAMP + 10, key=bytes(32)),
        signed_by_pymavlink(STAMP - 10),
        signed_by_pymavlink(STAMP - 7_000_000, system=9),  # a new stream, 70 s old
        MavlinkEncoder(7, 1).encode(AUTOPILOT),
        dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3).pack(dialect.MAVLink(None), force_mavlink1=True),
    ):
        assert not receiver.accepts(bytes(bad))
    assert dict(receiver.decoder.rejected) == {"replayed": 3, "forged": 2, "unsigned": 2}
    assert receiver.accepts(signed_by_pymavlink(STAMP + 1))


def test_a_forged_stamp_from_the_future_does_not_block_the_stream() -> None:
    """The digest is compared before the stamp counts."""
    receiver = Receiver()
    assert not receiver.accepts(signed_by_pymavlink(STAMP + 10**9, key=bytes(32)))
    assert receiver.accepts(signed_by_pymavlink(STAMP))
    assert not receiver.accepts(signed_by_pymavlink(STAMP + 10**9, key=bytes(32)))
    assert receiver.accepts(signed_by_pymavlink(STAMP + 1))


def test_streams_have_stamps_of_their_own() -> None:
    receiver = Receiver()
    assert receiver.accepts(signed_by_pymavlink(STAMP))
    assert receiver.accepts(signed_by_pymavlink(STAMP, system=8))
    assert not receiver.accepts(signed_by_pymavlink(STAMP, system=8))


def test_an_unsigned_autopilot_is_not_latched_where_there_is_a_key_and_counted() -> None:
    pipeline = Pipeline(Config(), {"autopilot": KEY})
    unsigned = MavlinkEncoder(7, 1).encode(AUTOPILOT)
    for frame, latched in ((unsigned, False), (signed_by_pymavlink(STAMP), True)):
        pipeline.feed(Datagram(channel="autopilot", encoding=Encoding.MAVLINK, t_recv_ns=NOW, data=frame))
        assert (pipeline.autopilot is not None) is latched
    assert pipeline.health(NOW).rejected["unsigned"] == 1
    pipeline.feed(Datagram(channel="other", encoding=Encoding.MAVLINK, t_recv_ns=NOW, data=unsigned))
    assert pipeline.health(NOW).rejected["unsigned"] == 1  # a link without a key takes what comes


def test_what_the_daemon_sends_is_signed_on_the_links_that_have_a_key() -> None:
    output = AutopilotOutput(Config(), keys={"autopilot": KEY})
    frame = MavlinkEncoder(7, 191).encode(AUTOPILOT)
    assert Verifier(KEY).check(output.signed("autopilot", frame, NOW), NOW) == ""
    assert output.signed("camera", frame, NOW) == frame


def test_a_key_is_64_hexadecimal_digits_or_a_passphrase() -> None:
    assert read_key(KEY.hex().encode() + b"\n") == KEY
    assert read_key(b"my secret\n") == hashlib.sha256(b"my secret").digest()
    assert read_key(b" \n") is None


def test_a_key_that_others_can_read_or_that_is_not_there_ends_the_start(tmp_path: Path) -> None:
    path = tmp_path / "key"
    link = LinkConfig(name="fc", url="udpin:127.0.0.1:0", key_file=str(path))
    assert signing_key(LinkConfig(name="fc", url="udpin:127.0.0.1:0")) is None
    with pytest.raises(ConfigError, match="No such file"):
        signing_key(link)
    path.write_text(KEY.hex(), encoding="ascii")
    for mode in (0o640, 0o604, 0o660):
        path.chmod(mode)
        with pytest.raises(ConfigError, match=r"link fc: key_file .*: others can read it; run chmod 600"):
            signing_key(link)
    path.chmod(0o600)
    assert signing_key(link) == KEY
    os.truncate(path, 0)
    with pytest.raises(ConfigError, match="is empty"):
        signing_key(link)

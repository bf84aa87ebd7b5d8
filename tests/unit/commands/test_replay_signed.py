"""A replay of a flight whose link was signed refuses what the flight refused, or says what it could not verify."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from onboard.analysis.flights.replay import ReplayResult
from onboard.analysis.flights.replay import replay as replayed_log
from onboard.commands.calibrate import collect
from onboard.commands.cli import main
from onboard.config import Config, parse_config
from onboard.messages import DOUBT_PREFIX, Datagram, Encoding, Estimate
from onboard.pipeline import Pipeline
from onboard.wire.mavlink.encode import MavlinkEncoder
from onboard.wire.mavlink.frame import frame_length
from onboard.wire.mavlink.signing import Signer
from tests.support.records import record
from tests.support.streams import CIRCLE, EPOCH, MS, SIZE, S, Stream

KEY = bytes(range(32))


def config(key_file: Path | None) -> Config:
    row: dict[str, Any] = {"name": "udp", "url": "udpin:127.0.0.1:0"}
    row |= {} if key_file is None else {"key_file": str(key_file)}
    return parse_config({"link": [row], "estimator": {"leader": {"size_prior_m": SIZE}}})


def frames(data: bytes) -> Iterator[bytes]:
    """The frames of a datagram: an image is three."""
    while length := frame_length(data, 0):
        yield data[:length]
        data = data[length:]


class Flown:
    """A flight on a signed link, into which a stranger sends false positions, unsigned and forged."""

    def __init__(self, folder: Path) -> None:
        self.key, self.log, signer, stranger = (
            folder / "key",
            folder / "flight.mcap",
            Signer(KEY, 0),
            Signer(b"", 0),
        )
        self.key.write_text(KEY.hex())
        self.key.chmod(0o600)
        plain = [replace(d, data=frame) for d in Stream(t1=9.0).datagrams() for frame in frames(d.data)]
        datagrams = [replace(d, data=signer.sign(d.data, d.t_recv_ns)) for d in plain]
        self.signed = len(datagrams)
        for k in range(20):
            at = CIRCLE.position(6 * S + 100 * k * MS)
            false = replace(at, r_OF_n=(at.r_OF_n[0] or 0.0, 500.0, -50.0))
            data, t_recv_ns = MavlinkEncoder(1, 1).encode(false), EPOCH + 6 * S + 100 * k * MS + 3 * MS
            data = stranger.sign(data, t_recv_ns) if k % 2 else data
            datagrams.append(Datagram(channel="udp", encoding=Encoding.MAVLINK, t_recv_ns=t_recv_ns, data=data))
        datagrams.sort(key=lambda d: d.t_recv_ns)
        pipeline = Pipeline(config(None), {"udp": KEY})
        self.estimates = [o for d in datagrams for o in pipeline.feed(d) if isinstance(o, Estimate)]
        record(self.log, datagrams)


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Flown:
    return Flown(tmp_path_factory.mktemp("signed"))


def named(result: ReplayResult) -> str:
    return "\n".join(r.reason for r in result.health.refusals if r.reason.startswith(DOUBT_PREFIX))


def test_with_the_key_a_replay_makes_what_the_flight_made(flown: Flown) -> None:
    result = replayed_log(flown.log, config(flown.key))
    assert result.estimates == flown.estimates
    assert sum(e.valid for e in flown.estimates) > 100
    assert (result.health.rejected["unsigned"], result.health.rejected["forged"]) == (10, 10)
    assert named(result) == ""


def test_without_the_key_what_is_not_signed_is_refused_and_the_others_are_counted(flown: Flown) -> None:
    result = replayed_log(flown.log, config(flown.key.with_name("elsewhere")))
    assert result.health.rejected["unsigned"] == 10
    assert f"{flown.signed + 10} signed frames were used unverified" in named(result)
    assert "elsewhere: No such file" in named(result)


def test_a_link_of_which_no_key_is_known_is_counted_too(flown: Flown, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(flown.log), "--set", f"estimator.leader.size_prior_m={SIZE}"]) == 0
    words = " ".join(capsys.readouterr().out.split())
    assert f"{flown.signed + 10} signed frames were used unverified" in words
    assert "name it in `key_file`" in words


def test_a_calibration_refuses_the_same(flown: Flown) -> None:
    settings = config(flown.key)
    _, own = collect(flown.log, settings, settings.camera_model())
    assert len(own.t) == 200, "positions of four seconds"

"""A .tlog holds MAVLink only, whatever sensors a scenario has."""

from pathlib import Path

import pytest

from onboard.wire.logs.tlog import read_tlog
from onboard.wire.mavlink.decode import MavlinkDecoder
from simlink.cli import main


@pytest.mark.parametrize("scenario", ["traffic", "traffic-gnss"])
def test_a_tlog_holds_mavlink_frames_only_seed_1(scenario: str, tmp_path: Path) -> None:
    path = tmp_path / "flight.tlog"
    assert main(["log", scenario, "--seed", "1", "--duration", "3", "--out", str(path)]) == 0
    decoder = MavlinkDecoder(stream=False)
    found = 0
    for datagram, _ in read_tlog(path.read_bytes()):
        assert datagram is not None
        assert datagram.data[0] in (0xFD, 0xFE)
        decoder.decode(datagram.data, datagram.t_recv_ns)
        found += 1
    assert found > 100
    assert not decoder.rejected

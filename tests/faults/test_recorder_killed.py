"""A recorder whose process is killed leaves what it had flushed."""

import subprocess
import sys
import time
from pathlib import Path

import pytest
from mcap.exceptions import McapError
from mcap.reader import make_reader

from onboard.commands import cli
from onboard.messages import Datagram
from onboard.wire.logs.recording import is_recording, read_recording

WRITER = """
import asyncio, sys
from pathlib import Path
from onboard.messages import Datagram, Encoding
from onboard.sinks import SinkRunner
from onboard.sinks.recorder import Recorder

async def main():
    runner = SinkRunner("recorder", Recorder(Path(sys.argv[1])), 10_000)
    task = asyncio.create_task(runner.run())
    for n in range(100_000):
        data = n.to_bytes(4, "big")
        runner.put(Datagram(channel="a", encoding=Encoding.MAVLINK, t_recv_ns=10**18 + n, data=data))
        await asyncio.sleep(0.001)

asyncio.run(main())
"""


def test_a_killed_recorder_leaves_what_it_had_flushed(tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    writer = subprocess.Popen([sys.executable, "-c", WRITER, str(path)])
    try:
        end = time.monotonic() + 300
        while not (path.exists() and is_recording(path) and len(found := list(read_recording(path))) > 100):
            assert time.monotonic() < end, "nothing was flushed"
            with pytest.raises(subprocess.TimeoutExpired):  # it goes on writing
                writer.wait(0.05)
    finally:
        writer.kill()
        writer.wait()
    after = [datagram for datagram, _ in read_recording(path)]
    assert after[-1] is None  # cut off, and reported as such
    assert len(after) >= len(found)
    for n, datagram in enumerate(after[:-1]):
        assert isinstance(datagram, Datagram)
        assert (datagram.t_recv_ns, datagram.data) == (10**18 + n, n.to_bytes(4, "big"))
    with pytest.raises(McapError), path.open("rb") as file:
        list(make_reader(file).iter_messages())  # mcap's ordinary reader wants the end
    recovered = tmp_path / "recovered.mcap"
    assert cli.main(["recover", str(path), "--out", str(recovered)]) == 0
    with recovered.open("rb") as file:
        stamps = [message.log_time for _, _, message in make_reader(file).iter_messages()]
    assert stamps == [10**18 + n for n in range(len(after) - 1)]

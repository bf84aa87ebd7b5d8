"""A program whose sink is stuck in a write still ends on request."""

import subprocess
import sys

PROGRAM = """
import asyncio, threading
from onboard.sinks import SinkRunner

class Stuck:
    def open(self): pass
    def write(self, records): threading.Event().wait()
    def close(self): pass

async def main():
    task = asyncio.create_task(SinkRunner("stuck", Stuck(), 10, close_timeout_s=0.1).run())
    await asyncio.sleep(0.5)
    task.cancel()
    await asyncio.wait({task})

asyncio.run(main())
print("ended")
"""


def test_a_program_whose_sink_is_stuck_ends_all_the_same() -> None:
    command = [sys.executable, "-c", PROGRAM]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)
    assert ended.stdout == "ended\n"

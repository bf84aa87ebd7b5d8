"""A subscriber that stops reading, and a publisher that goes on."""

import os
import resource
import select
import signal
import subprocess
import sys
import time

from onboard.sinks.zenoh import ZenohSink
from onboard.sinks.zenoh_session import ZenohConfig, open_session
from tests.support.programs import free_endpoint
from tests.support.records import POSE

SUBSCRIBER = """
import sys, zenoh
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", '["' + sys.argv[1] + '"]')
session = zenoh.open(config)
subscriber = session.declare_subscriber("onboard/**", lambda sample: print("received", flush=True))
sys.stdin.read()  # until the test ends it, or ends itself
"""


def waits(sink: ZenohSink, count: int) -> int:
    """How often this thread gives up the processor, to wait for something, while it writes `count` records."""
    before = resource.getrusage(resource.RUSAGE_THREAD).ru_nvcsw
    for _ in range(count):
        sink.write([POSE])
    return resource.getrusage(resource.RUSAGE_THREAD).ru_nvcsw - before


def test_publishing_to_a_subscriber_that_no_longer_reads_does_not_wait() -> None:
    endpoint = free_endpoint()
    session = open_session(ZenohConfig(vehicle="a", listen=(endpoint,)))
    peer = subprocess.Popen(
        [sys.executable, "-c", SUBSCRIBER, endpoint], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    try:
        sink = ZenohSink(session, "onboard/a")
        sink.open()
        assert peer.stdout is not None
        os.set_blocking(peer.stdout.fileno(), False)
        end = time.monotonic() + 300
        while not peer.stdout.read():
            assert time.monotonic() < end, "the subscriber received nothing"
            sink.write([POSE])
            select.select([peer.stdout], [], [], 0.02)
        os.kill(peer.pid, signal.SIGSTOP)
        # 10 MB, more than sockets and queues hold: to wait for room would be one wait for nearly every record
        assert waits(sink, 50_000) < 500
        sink.close()
    finally:
        peer.kill()
        peer.wait()
        for stream in (peer.stdin, peer.stdout):
            stream.close() if stream else None
        session.close()

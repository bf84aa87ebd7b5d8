"""A subscriber that stops reading, and a publisher that goes on."""

import os
import signal
import socket
import subprocess
import sys
import time

from onboard.messages import OwnPose
from onboard.sinks.zenoh import ZenohSink
from onboard.sinks.zenoh_session import ZenohConfig, open_session

SUBSCRIBER = """
import sys, zenoh
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", '["' + sys.argv[1] + '"]')
session = zenoh.open(config)
subscriber = session.declare_subscriber("onboard/**", lambda sample: print("heard", flush=True))
sys.stdin.read()  # until whoever started it ends it, or ends
"""


def test_publishing_to_a_subscriber_that_no_longer_reads_stays_cheap() -> None:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{s.getsockname()[1]}"
    session = open_session(ZenohConfig(vehicle="a", listen=(endpoint,)))
    peer = subprocess.Popen(
        [sys.executable, "-c", SUBSCRIBER, endpoint], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    try:
        sink = ZenohSink(session, "onboard/a")
        sink.open()
        zeros = (0.0, 0.0, 0.0)
        pose = OwnPose(t_ns=1, r_OF_n=zeros, v_F_n=zeros, a_F_n=zeros, q_nb=(1.0, 0.0, 0.0, 0.0))
        assert peer.stdout is not None
        os.set_blocking(peer.stdout.fileno(), False)
        end = time.monotonic() + 20
        while not peer.stdout.read():
            assert time.monotonic() < end, "the subscriber heard nothing"
            sink.write([pose])
            time.sleep(0.02)
        os.kill(peer.pid, signal.SIGSTOP)
        slowest, begun = 0.0, time.monotonic()
        for _ in range(50_000):  # 10 MB: more than sockets and queues hold
            t = time.monotonic()
            sink.write([pose])
            slowest = max(slowest, time.monotonic() - t)
        assert time.monotonic() - begun < 10.0  # 0.2 s here; a millisecond each would be 50 s
        assert slowest < 0.5
        sink.close()
    finally:
        peer.kill()
        peer.wait()
        for stream in (peer.stdin, peer.stdout):
            stream.close() if stream else None
        session.close()

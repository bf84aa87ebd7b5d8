"""The simulator's server over Zenoh, and as a program that a signal ends."""

import asyncio
import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import msgspec
import pytest

from onboard.messages import CameraPoints, SimStatus, Truth
from tests.support.simlink_server import make, run


@pytest.fixture
def router() -> Iterator[tuple[str, Any]]:
    """(endpoint, session) of a Zenoh router inside the test."""
    zenoh = pytest.importorskip("zenoh")
    for _ in range(5):
        with socket.create_server(("127.0.0.1", 0)) as probe:
            endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
        config = zenoh.Config()
        config.insert_json5("mode", '"router"')
        config.insert_json5("scouting/multicast/enabled", "false")
        config.insert_json5("listen/endpoints", json.dumps([endpoint]))
        try:
            session = zenoh.open(config)
        except zenoh.ZError:
            continue  # somebody took the port in between
        yield endpoint, session
        session.close()
        return
    pytest.fail("no free port")


def test_images_truth_and_counts_arrive_over_zenoh_seed_1(router: tuple[str, Any]) -> None:
    endpoint, session = router
    received: dict[str, list[bytes]] = {}

    def keep(sample: Any) -> None:
        received.setdefault(str(sample.key_expr), []).append(sample.payload.to_bytes())

    subscribers = [session.declare_subscriber(key, keep) for key in ("simlink/**", "onboard/**")]
    server = make(camera="zenoh", zenoh=endpoint, vehicle="robot/9", wait=1000.0)
    run(lambda: server.run(asyncio.Event()))
    points = [msgspec.json.decode(x, type=CameraPoints) for x in received["onboard/robot/9/camera/front/points"]]
    truth = [msgspec.json.decode(x, type=Truth) for x in received["simlink/robot/9/truth"]]
    status = [msgspec.json.decode(x, type=SimStatus) for x in received["simlink/robot/9/status"]]
    for subscriber in subscribers:
        subscriber.undeclare()
    assert len(truth) == 51
    assert status[-1].finished
    assert not any(s.finished for s in status[:-1])
    assert status[-1].images == len(points) == server.images > 40
    assert {p.t_ns for p in points} < {t.t_ns for t in truth}
    distance = sum(x * x for x in truth[0].r_FL_n) ** 0.5
    assert distance == pytest.approx(27.64, abs=1.5)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_it_cleanly(number: signal.Signals, request: pytest.FixtureRequest) -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)  # as in a terminal: `nohup` ignores it
    request.addfinalizer(lambda: signal.signal(signal.SIGHUP, before))
    arguments = [
        "run",
        "formation",
        "--camera",
        "none",
        "--zenoh",
        "none",
        "--tcp",
        "none",
        "--mavlink",
        "udpin:127.0.0.1:0",
    ]
    with subprocess.Popen(
        [sys.executable, "-m", "simlink", *arguments], stderr=subprocess.PIPE, text=True, env=dict(os.environ)
    ) as process:
        try:
            assert process.stderr is not None
            while "flying" not in (line := process.stderr.readline()):
                assert line
            process.send_signal(number)
            output = process.stderr.read()
            assert process.wait(20) == 0
        finally:
            process.kill()
    assert "sent 0 MAVLink frames" in output
    assert "Traceback" not in output

"""A process that is paused and resumed, as by `docker pause`, a suspend or a stalled disk.

It must not publish outdated data, and must name the cause.
"""

import os
import re
import signal
import time
from contextlib import closing
from pathlib import Path
from typing import Any

from onboard.analysis.flights.replay import replay
from onboard.config import load_config
from onboard.messages import Cause, Estimate, Health
from onboard.wire.logs.recording import read_recording
from tests.support.daemon import Observer, Relay, Setup
from tests.support.programs import until
from tests.support.records import read_estimates

PAUSE_TIME_S = 1.7
MAX_AGE_NS = 500_000_000  # `max_age_s`
IMAGE_AGE_S = 0.1  # an image arrives 60 ms late, after newer own motion
IMAGE_TIMEOUT_S = 2.0  # `validity_timeout_s`
SETTINGS = (
    "leader_out=[{link='autopilot', rates_hz={FOLLOW_TARGET=20.0}}]",
    "odometry.link='autopilot'",
    "estimator.own_state={}",
)


def pause(process: int) -> tuple[int, int]:
    """When a process was stopped, and continued, by the wall clock, ns."""
    os.kill(process, signal.SIGSTOP)
    until(lambda: is_stopped(process), "a process that stands still")
    stopped_ns = time.time_ns()
    time.sleep(PAUSE_TIME_S)
    continued_ns = time.time_ns()
    os.kill(process, signal.SIGCONT)
    return stopped_ns, continued_ns


def is_stopped(process: int) -> bool:
    """Whether all threads of a process are stopped; until then it may publish after the signal."""
    stats = Path(f"/proc/{process}/task").glob("*/stat")
    return {stat.read_text().rpartition(")")[2].split()[0] for stat in stats} == {"T"}


def published(observer: Observer, since_ns: int) -> list[Any]:
    """Return the records published after a wall-clock time, ns, until the leader is tracked again."""
    found: list[Any] = []

    def is_back() -> bool:
        while (received := observer.client.take(0.02)) is not None:
            if received.t_publish_ns is not None and received.t_publish_ns > since_ns:
                found.append(received.record)
        leader = [r for r in found if isinstance(r, Estimate) and r.name == "leader"]
        fused = [r for r in leader if r.valid and r.age is not None and r.age < IMAGE_AGE_S]
        healths = [r for r in found if isinstance(r, Health)]
        return len(fused) > 20 and len(healths) > 4

    until(is_back, "images that are fused again")
    return found


def sent_as_valid(relay: Relay, begin: int) -> list[int]:
    """Return the boot times, ns, of our own state and of the leader as sent to the autopilot."""
    frames = relay.frames()[begin:]
    odometry = [m.time_usec * 1_000 for m in frames if m.get_type() == "ODOMETRY" and m.quality >= 0]
    follow = [m.timestamp * 1_000_000 for m in frames if m.get_type() == "FOLLOW_TARGET"]
    assert odometry
    assert follow
    return odometry + follow


def test_a_process_that_is_stopped_publishes_nothing_old_as_valid_seed_6(tmp_path: Path) -> None:
    setup, recording = Setup(tmp_path), tmp_path / "flight.mcap"
    with (
        setup.daemon(f"udpin:127.0.0.1:{setup.autopilot}", f"recorder.path='{recording}'", *SETTINGS) as daemon,
        closing(Relay(setup.autopilot)) as relay,
    ):
        observer = setup.observer()
        links = ("--mavlink", f"udpout:127.0.0.1:{relay.port}", "--tcp", "none", "--zenoh", "none")
        links += ("--camera", "mavlink", "--camera-mavlink", f"udpout:127.0.0.1:{setup.camera}")
        with setup.simulator(*links, "--wait", "300", seed=6):
            until(lambda: relay.count("FOLLOW_TARGET") and observer.is_tracking(), "a leader to follow")
            stopped_ns, continued_ns = pause(daemon.popen.pid)
            begin = len(relay.frames())
            records = published(observer, stopped_ns)
            times = sent_as_valid(relay, begin)
        observer.client.close()
        assert daemon.end() == 0
    healths = [r for r in records if isinstance(r, Health)]
    offset_ns = healths[-1].clock_offset_ns
    assert offset_ns is not None
    oldest_ns = continued_ns - offset_ns - MAX_AGE_NS
    assert len([t for t in times if t < oldest_ns]) <= 1  # one may have been judged, and not sent, as it stopped
    valid = [r for r in records if isinstance(r, Estimate) and r.valid]
    assert {e.name for e in valid} == {"leader", "own_state"}
    assert [e for e in valid if e.t_ns < oldest_ns] == []
    of_images = [e for e in valid if e.name == "leader" and e.age is not None]
    assert [e for e in of_images if e.t_ns - e.age * 1e9 < oldest_ns - IMAGE_TIMEOUT_S * 1e9] == []
    assert_named_as_our_own(healths, daemon.output())
    assert_replays_with_its_waits(setup, recording)


def assert_named_as_our_own(healths: list[Health], lines: str) -> None:
    assert max(map(float, re.findall(r"this program stood still for ([\d.]+) s", lines)), default=0.0) > 1.5
    assert "datagrams had waited too long and were left out" in lines
    autopilot = healths[-1].links["autopilot"]
    assert autopilot.skipped + autopilot.shed > 100  # on a busy computer the burst is beyond its budget first
    assert healths[-1].links["camera"].skipped > 10
    assert "silent" not in lines
    assert "needed are" not in lines
    assert "refused from" not in lines


def assert_replays_with_its_waits(setup: Setup, recording: Path) -> None:
    """Each estimate that was made of datagrams is made of them again, valid or not."""
    datagrams = [datagram for datagram, _ in read_recording(recording) if datagram is not None]
    assert max(d.waited_us for d in datagrams) > 10_000
    live = [e for e in read_estimates(recording) if e.cause is not Cause.SILENT]
    settings = load_config(setup.config, SETTINGS[-1:])
    again = [e for e in replay(recording, settings).estimates if e.name == "leader"]
    assert live == again

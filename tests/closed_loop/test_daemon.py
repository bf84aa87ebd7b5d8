"""`onboard run` and `simlink run` as processes over real links: messages both ways, and recording."""

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from onboard.analysis.flights.replay import replay
from onboard.clocks import MAX_ROUND_TRIP_TIME_NS
from onboard.commands import cli
from onboard.config import load_config
from onboard.messages import Cause, Estimate, TimeSync
from onboard.wire.datagrams import DatagramDecoder
from onboard.wire.logs.recording import read_recording
from tests.support.daemon import Observer, Setup, queried
from tests.support.programs import TIMEOUT_S, until
from tests.support.records import read_estimates


@pytest.fixture
def setup(tmp_path: Path) -> Iterator[Setup]:
    made = Setup(tmp_path)
    yield made
    for observer in made.observers:
        observer.client.close()


USED = "leader.warm_start_used"


def assert_replays_bit_for_bit(setup: Setup, recording: Path, shed: int) -> None:
    """Each live estimate equals the replayed one, number for number.

    A timer's withdrawals are not repeated. `shed`: so many datagrams had waited too long on a busy computer and
    were left out.
    """
    live = [e for e in read_estimates(recording) if e.cause is not Cause.SILENT]
    assert len(live) + shed > 3 * 30  # of four seconds, 30 a second
    again = replay(recording, load_config(setup.config))
    assert again.damaged == 0
    for a, b in zip(live, again.estimates, strict=True):
        assert a == b, f"estimate {a.sequence} differs"


def late_replies(recording: Path) -> int:
    """Count the replies to TIMESYNC that took too long to be believed, as on a busy computer."""
    decoder = DatagramDecoder()
    datagrams = [datagram for datagram, _ in read_recording(recording) if datagram is not None]
    messages = [message for datagram in datagrams for message in decoder.decode(datagram)]
    took = [m.t_recv_ns - m.ts1_ns for m in messages if isinstance(m, TimeSync) and m.tc1_ns]
    assert took
    return sum(ns > MAX_ROUND_TRIP_TIME_NS for ns in took)


@pytest.mark.parametrize("kind", ["udp and zenoh", "tcp and landing targets"])
def test_recorded_flight_seed_1_replays_bit_for_bit(setup: Setup, kind: str) -> None:
    recording = setup.folder / "flight.mcap"
    if kind == "udp and zenoh":
        url = f"udpin:127.0.0.1:{setup.autopilot}"
        links: tuple[str, ...] = ("--mavlink", f"udpout:127.0.0.1:{setup.autopilot}", "--tcp", "none")
        links += ("--zenoh", setup.endpoint)
    else:
        url = f"tcp:127.0.0.1:{setup.tcp}"
        links = ("--mavlink", "none", "--tcp", str(setup.tcp), "--zenoh", "none", "--camera", "mavlink")
        links += ("--camera-mavlink", f"udpout:127.0.0.1:{setup.camera}")
    with setup.daemon(url, f"recorder.path='{recording}'") as daemon:
        observer = setup.observer()
        with setup.simulator(*links, "--wait", "300", "--duration", "4") as simulator:
            assert simulator.popen.wait(TIMEOUT_S) == 0
        observer.receive()
        health = observer.newest()
        assert daemon.end(signal.SIGTERM) == 0
    assert "stopped" in daemon.output()
    assert "Traceback" not in daemon.output()
    shed = sum(link.skipped + link.dropped for link in health.links.values())
    assert health.verdicts.get("leader.fused", 0) + shed > 50
    assert health.clock_source == "timesync"
    assert all(sink.dropped == 0 for sink in health.sinks.values())
    assert set(health.rejected) <= {"timesync_not_ours"}, health.rejected
    assert health.rejected.get("timesync_not_ours", 0) <= late_replies(recording)
    assert health.links["autopilot"].received
    assert_replays_bit_for_bit(setup, recording, shed)


def test_daemon_survives_a_reboot_of_the_autopilot_seeds_3_and_4(setup: Setup) -> None:
    """The simulator is killed and restarted: no valid estimate meanwhile, then a new track.

    Its boot clock begins where it began before, some seconds back, and not near zero: for us it has set its clock,
    or, where the restart took long on a busy computer, it has rebooted.
    """
    links = ("--mavlink", f"udpout:127.0.0.1:{setup.autopilot}", "--tcp", "none", "--zenoh", setup.endpoint)
    key = "onboard/1/estimate/leader"
    with setup.daemon(f"udpin:127.0.0.1:{setup.autopilot}") as daemon:
        observer = setup.observer()
        with setup.simulator(*links, "--wait", "300", seed=3) as simulator:
            until(observer.is_tracking, "a track")
            until(lambda: is_published_as_valid(setup.endpoint, key), "a valid estimate, as a reply to a query")
            start_ns = observer.estimates[-1].t_ns
            # long enough that the restart sets the boot clock back by more than a second
            until(lambda: observer.is_tracking() and observer.estimates[-1].t_ns > start_ns + 3e9, "three seconds")
            simulator.end(signal.SIGKILL)
        daemon.wait_for("the autopilot is silent")
        value, attachment = queried(setup.endpoint, key)
        assert (value["valid"], value["state"]) == (False, "lost")
        assert attachment["stale"] is True
        assert attachment["age_s"] > 2
        observer.receive()
        before = len(observer.estimates)
        with setup.simulator(*links, "--wait", "300", log="again.log", seed=4):
            until(lambda: has_begun_anew(daemon.output()), "a new boot clock")
            daemon.wait_for("the autopilot is heard again")
            until(observer.is_tracking, "a new track")
            assert len(observer.estimates) > before

        assert daemon.end() == 0
    assert "Traceback" not in daemon.output()
    new = observer.estimates[before:]
    assert any(not e.valid for e in new[:50])
    assert new[-1].reset_count > observer.estimates[before - 1].reset_count


def is_published_as_valid(endpoint: str, key: str) -> bool:
    """Always but for moments in which a busy computer stands still."""
    value, attachment = queried(endpoint, key)
    assert not (value["valid"] and attachment["stale"])
    return bool(value["valid"])


def has_begun_anew(output: str) -> bool:
    return any(f"the autopilot has {what}" in output for what in ("set its clock", "rebooted"))


def began(estimate: Estimate) -> bool:
    return estimate.t_ns > 0


def is_valid(estimate: Estimate) -> bool:
    return estimate.valid


def test_a_killed_daemon_comes_back_with_what_it_knew_seed_5(setup: Setup) -> None:
    """A state is used for 10 s, and while the clocks agree within half a second.

    It is tried again if a start or the first message takes longer because many programs run.
    """
    url = f"udpin:127.0.0.1:{setup.autopilot}"
    links = ("--mavlink", f"udpout:127.0.0.1:{setup.autopilot}", "--tcp", "none", "--zenoh", "none")
    links += ("--camera", "mavlink", "--camera-mavlink", f"udpout:127.0.0.1:{setup.camera}")
    state = setup.folder / "state.json"
    with setup.simulator(*links, seed=5):
        recording = next(filter(None, (killed_and_started(setup, url, state, k) for k in range(5))))
    estimates = read_estimates(recording)
    begun_ns, valid_ns = (next(e.t_ns for e in estimates if test(e)) for test in (began, is_valid))
    assert valid_ns - begun_ns < 1_000_000_000
    assert_replays_bit_for_bit(setup, recording, 0)  # it had seen more


def outcomes_of_warm_start(observer: Observer) -> set[str]:
    """Return the outcomes of the state that was read: verdicts, or the sources of refusals."""
    observer.receive()
    health = observer.newest()
    verdicts = {name for name in health.verdicts if name.startswith("leader.warm_start_")}
    return verdicts | ({one.source for one in health.refusals} & {"warm_state"})


def killed_and_started(setup: Setup, url: str, state: Path, k: int) -> Path | None:
    """Return the recording of a daemon that has started from a killed one's state.

    It is None if that state was too old.
    """
    recording, path = setup.folder / f"again-{k}.mcap", f"warm_start.path='{state}'"
    state.unlink(missing_ok=True)
    with setup.daemon(url, path) as daemon:
        until(setup.observer().is_tracking, "the leader")
        until(state.exists, "a state")
        daemon.end(signal.SIGKILL)
    with setup.daemon(url, path, f"recorder.path='{recording}'") as daemon:
        daemon.wait_for(str(state))
        if "is ignored: it is" in daemon.output():
            return None
        observer = setup.observer()
        outcomes: set[str] = until(lambda: outcomes_of_warm_start(observer), "a warm start")
        if outcomes & {"leader.warm_start_too_late", "warm_state"}:
            return None
        assert outcomes == {USED}

        def has_seen_many() -> bool:
            observer.receive()
            return len(observer.estimates) > 120

        until(has_seen_many, "estimates")
        assert daemon.end(signal.SIGTERM) == 0
    return recording


def refused(capsys: pytest.CaptureFixture[str], *settings: str) -> str:
    """The one line in which `onboard run` says why it does not start."""
    assert cli.main(["run", *(a for setting in settings for a in ("--set", setting))]) == 2
    (line,) = [text for text in capsys.readouterr().err.splitlines() if text.startswith("onboard:")]
    return line


def test_what_is_taken_is_named_and_no_recording_is_overwritten(
    setup: Setup, capsys: pytest.CaptureFixture[str]
) -> None:
    """A second daemon on the ports of the first, and one without a folder for its recordings, fail."""
    recording = setup.folder / "flight.mcap"
    recording.write_bytes(b"precious")
    url = f"udpin:127.0.0.1:{setup.autopilot}"
    with setup.daemon(url, f"recorder.path='{recording}'") as daemon:
        assert url in refused(capsys, f"link=[{{name='a', url='{url}'}}]", "zenoh.enabled=false")
        assert setup.endpoint in refused(capsys, "link=[]", f"zenoh.listen=['{setup.endpoint}']")
        until((setup.folder / "flight-2.mcap").exists, "the recording")
        assert daemon.end() == 0
    assert recording.read_bytes() == b"precious"
    line = refused(capsys, f"recorder.path='{recording}/x.mcap'", "zenoh.enabled=false")
    assert f"cannot record to {recording}/x.mcap" in line

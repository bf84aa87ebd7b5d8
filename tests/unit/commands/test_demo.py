"""The demo's own parts."""

import contextlib
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from onboard.commands import demo_flight, processes
from onboard.commands.processes import DemoError, Process, connect, interruptions
from onboard.messages import Cause
from onboard.sinks.zenoh_session import RouterAbsentError


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_an_interruption_that_is_lost_is_heeded_all_the_same(number: signal.Signals) -> None:
    """As one raised while an object is finalised is: Python prints it and goes on."""
    ours = signal.getsignal(number)
    before = signal.default_int_handler
    signal.signal(number, before)  # under nohup SIGHUP would be ignored
    try:
        with interruptions() as heed:
            heed()
            with contextlib.suppress(KeyboardInterrupt):
                signal.raise_signal(number)
            with pytest.raises(KeyboardInterrupt):
                heed()
        assert signal.getsignal(number) is before
    finally:
        signal.signal(number, ours)


def test_an_interruption_interrupts() -> None:
    with interruptions(), pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


def test_a_scenario_with_pictures_flies_with_the_example_of_its_name_or_says_what_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = demo_flight._example("pictures-tag")
    assert found is not None
    assert found.name == "tag.py"
    assert demo_flight._example("formation") is None
    monkeypatch.setattr(demo_flight, "__file__", str(tmp_path / "onboard" / "commands" / "demo_flight.py"))
    with pytest.raises(DemoError, match="scenario pictures needs --detector, such as"):
        demo_flight._example("pictures")


class FakeClient:
    """As a client of a daemon whose router answers at the third attempt, and which publishes after three waits."""

    attempts, waits, closed = 0, 0, 0

    def __init__(self, _endpoint: str, _vehicle: str) -> None:
        type(self).attempts += 1
        if self.attempts < 3:
            raise RouterAbsentError("no router answers", Cause.UNREACHABLE)
        self.alive = self

    def wait(self, _seconds: float) -> bool:
        type(self).waits += 1
        return self.waits > 3

    def close(self) -> None:
        type(self).closed += 1


def sleeper(folder: Path, code: str) -> Process:
    popen = subprocess.Popen([sys.executable, "-c", code])
    return Process("onboard", popen, folder / "log")


@pytest.fixture
def client(monkeypatch: pytest.MonkeyPatch) -> type[FakeClient]:
    made = type("Fake", (FakeClient,), {})
    monkeypatch.setattr(processes, "Client", made)
    monkeypatch.setattr(processes, "CONNECT_RETRY_PERIOD_S", 0.01)
    return made


def test_a_daemon_that_starts_slowly_is_waited_for_and_the_seconds_are_told(
    client: type[FakeClient], tmp_path: Path
) -> None:
    daemon, waited = sleeper(tmp_path, "import time; time.sleep(600)"), []
    try:
        connect("tcp/127.0.0.1:1", "1", daemon, waited.append)
    finally:
        daemon.popen.kill()
        daemon.popen.wait()
    assert (client.attempts, client.waits, client.closed) == (3, 4, 0)
    assert len(waited) == 6
    assert waited == sorted(waited)


@pytest.mark.parametrize(
    ("code", "words"), [(0, "ended with code 0 before"), (3, "ended with code 3: its last words")]
)
def test_a_daemon_that_ends_is_not_waited_for(
    client: type[FakeClient], code: int, words: str, tmp_path: Path
) -> None:
    (tmp_path / "log").write_text("its last words\n", encoding="utf-8")
    client.attempts, client.waits = 3, -(10**9)  # it never publishes
    daemon = sleeper(tmp_path, f"import time; time.sleep(0.5); raise SystemExit({code})")
    with pytest.raises(DemoError, match=words):
        connect("tcp/127.0.0.1:1", "1", daemon, lambda _: None)
    assert client.closed == 1


def test_certificates_that_are_refused_are_not_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> None:
        raise RouterAbsentError("its certificate is refused", Cause.TLS)

    monkeypatch.setattr(processes, "Client", refused)
    daemon = sleeper(tmp_path, "import time; time.sleep(600)")
    try:
        with pytest.raises(RouterAbsentError, match="certificate"):
            connect("tls/127.0.0.1:1", "1", daemon, lambda _: None)
    finally:
        daemon.popen.kill()
        daemon.popen.wait()

"""`onboard run` beside `simlink run`, each a process, over real links: what is heard, said and recorded."""

import json
import select
import signal
import socket
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import zenoh
from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.commands.log_replay import replay
from onboard.config import load_config
from onboard.messages import Estimate, Health
from onboard.view.client import Client
from onboard.wire.recording import read_estimates
from tests.support.programs import Program, free_ports, run, started, until

UDP, TCP = socket.SOCK_DGRAM, socket.SOCK_STREAM


class Relay:
    """Between the daemon's port and the simulator: passes everything on, and keeps what the daemon sends."""

    def __init__(self, daemon_port: int) -> None:
        self.from_daemon: list[bytes] = []
        self._simulator = socket.socket(socket.AF_INET, UDP)  # the simulator sends here
        self._simulator.bind(("127.0.0.1", 0))
        self.port = int(self._simulator.getsockname()[1])
        self._daemon = socket.socket(socket.AF_INET, UDP)
        self._daemon.bind(("127.0.0.1", 0))
        self._to = ("127.0.0.1", daemon_port)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def inject(self, frame: bytes) -> None:
        """To the daemon, as if from the simulator."""
        self._daemon.sendto(frame, self._to)

    def frames(self) -> list[Any]:
        """What the daemon sent, as an independent parser reads it."""
        parser = dialect.MAVLink(None)
        return [m for data in list(self.from_daemon) for m in parser.parse_buffer(data) or []]

    def heard(self, kind: str) -> int:
        """How many messages of that kind the daemon sent."""
        return sum(m.get_type() == kind for m in self.frames())

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self._simulator.close()
        self._daemon.close()

    def _run(self) -> None:
        peer: Any = None
        while not self._stop.is_set():
            for ready in select.select([self._simulator, self._daemon], [], [], 0.1)[0]:
                try:
                    data, address = ready.recvfrom(65_536)
                except ConnectionError:  # nobody listens there now
                    continue
                if ready is self._simulator:
                    peer = address
                    self._daemon.sendto(data, self._to)
                elif peer is not None:
                    self.from_daemon.append(data)
                    self._simulator.sendto(data, peer)


class Observer:
    """A client that keeps the newest health and all estimates."""

    def __init__(self, endpoint: str) -> None:
        self.client: Client = until(lambda: self._connect(endpoint), "the daemon's Zenoh")
        self.estimates: list[Estimate] = []
        self.health: Health | None = None

    @staticmethod
    def _connect(endpoint: str) -> Client | None:
        try:
            return Client(endpoint, "1")
        except Exception:  # not up yet
            return None

    def look(self) -> None:
        """Take what has come so far; more comes all the while."""
        end = time.monotonic() + 0.2
        while time.monotonic() < end and (received := self.client.take(0.02)) is not None:
            match received.record:
                case Estimate() as estimate:
                    self.estimates.append(estimate)
                case Health() as health:
                    self.health = health

    def newest(self) -> Health:
        """The newest health, one at least."""

        def have() -> Health | None:
            self.look()
            return self.health

        found: Health = until(have, "a health")
        return found

    def is_tracking(self) -> bool:
        self.look()
        return bool(self.estimates) and self.estimates[-1].valid and self.estimates[-1].state == "tracking"


class Setup:
    """Ports, the daemon's command line and the simulator's."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.observers: list[Observer] = []
        self.autopilot, self.camera = free_ports(UDP, UDP)
        self.tcp, self.zenoh = free_ports(TCP, TCP)
        self.endpoint = f"tcp/127.0.0.1:{self.zenoh}"
        self.config = folder / "formation.toml"
        self.config.write_text(run("simlink", "config", "formation").stdout)

    def observer(self) -> Observer:
        """A client of the daemon, closed when the test is over."""
        self.observers.append(Observer(self.endpoint))
        return self.observers[-1]

    def settings(self, autopilot_url: str, *more: str) -> tuple[str, ...]:
        camera = f"{{name='camera', url='udpin:127.0.0.1:{self.camera}', autopilot=false}}"
        return (
            f"link=[{{name='autopilot', url='{autopilot_url}'}}, {camera}]",
            f"zenoh.listen=['{self.endpoint}']",
            *more,
        )

    @contextmanager
    def daemon(self, autopilot_url: str, *more: str) -> Iterator[Program]:
        settings = [a for setting in self.settings(autopilot_url, *more) for a in ("--set", setting)]
        with started(self.folder / "daemon.log", "onboard", "run", self.config, *settings) as program:
            program.wait_for("link camera")
            yield program

    @contextmanager
    def simulator(self, *arguments: str, log: str = "simlink.log", seed: int = 1) -> Iterator[Program]:
        command = ("simlink", "run", "formation", "--seed", str(seed), "--speed", "1", *arguments)
        with started(self.folder / log, *command) as program:
            program.wait_for("flying")
            yield program


@pytest.fixture
def setup(tmp_path: Path) -> Iterator[Setup]:
    made = Setup(tmp_path)
    yield made
    for observer in made.observers:
        observer.client.close()


def assert_replays_bit_for_bit(setup: Setup, recording: Path) -> None:
    """Every estimate that was made live, number for number."""
    live = list(read_estimates(recording))
    assert len(live) > 200
    again = replay(recording, load_config(setup.config)).estimates
    for a, b in zip(live, again, strict=True):
        assert a == b, f"estimate {a.sequence} differs"


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
        with setup.simulator(*links, "--wait", "15", "--duration", "8") as simulator:
            assert simulator.popen.wait(60) == 0
        observer.look()
        health = observer.newest()
        assert daemon.end(signal.SIGTERM) == 0
    assert "stopped" in daemon.said()
    assert "Traceback" not in daemon.said()
    assert health.verdicts.get("leader.fused", 0) > 100
    assert health.clock_source == "timesync"
    assert all(sink.dropped == 0 for sink in health.sinks.values())
    assert not health.rejected, health.rejected
    assert_replays_bit_for_bit(setup, recording)
    again = run("onboard", "replay", recording, "--config", setup.config, "--json", setup.folder / "r.json")
    assert again.returncode == 0, again.stderr
    assert json.loads((setup.folder / "r.json").read_bytes())["log"]["damaged"] == 0


def test_daemon_is_a_good_citizen_of_the_link_seed_2(setup: Setup) -> None:
    """Heartbeats as an onboard controller, TIMESYNC, rates asked for; a second autopilot is not ours."""
    with setup.daemon(
        f"udpin:127.0.0.1:{setup.autopilot}",
        *("autopilot.rates_hz.GPS_RAW_INT=20.0", "autopilot.rates_hz.LOCAL_POSITION_NED=100.0"),
    ) as daemon:
        relay = Relay(setup.autopilot)
        try:
            observer = setup.observer()
            links = ("--mavlink", f"udpout:127.0.0.1:{relay.port}", "--tcp", "none", "--zenoh", setup.endpoint)
            with setup.simulator(*links, "--wait", "15", seed=2):
                until(observer.is_tracking, "a track")
                stranger = dialect.MAVLink(None, srcSystem=9, srcComponent=1)
                for _ in range(10):  # says it is upside down and elsewhere
                    for message in (
                        stranger.heartbeat_encode(2, 3, 0, 0, 4),
                        stranger.attitude_quaternion_encode(41_000, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0),
                        stranger.local_position_ned_encode(41_000, 1e4, 1e4, 0.0, 0.0, 0.0, 0.0),
                    ):
                        relay.inject(message.pack(stranger))
                    time.sleep(0.05)

                def rates_are_met() -> bool:
                    streams = observer.newest().streams
                    observer.look()
                    gps, position = streams.get("GpsFix"), streams.get("LocalPosition")
                    return bool(gps and position and gps.rate > 16 and position.rate > 80)

                until(rates_are_met, "the rates that were asked for")
                # until the health counts what the stranger said
                until(
                    lambda: observer.newest().rejected.get("other_system", 0) >= 30 or observer.look(),
                    "it counted",
                )
                health = observer.newest()
                assert observer.is_tracking()
                assert health.autopilot == "PX4, system 1"
                assert health.autopilot_reboots == 0
                assert health.verdicts.get("leader.gated", 0) == 0
                asked, beats = relay.heard("COMMAND_LONG"), relay.heard("HEARTBEAT")
                # one a second: longer than until it would ask again
                until(lambda: relay.heard("HEARTBEAT") >= beats + 7, "seven more heartbeats")
                frames = relay.frames()
        finally:
            relay.close()
        assert daemon.end() == 0
    kinds = Counter(m.get_type() for m in frames)
    assert set(kinds) == {"HEARTBEAT", "TIMESYNC", "COMMAND_LONG"}
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in frames} == {(1, 191)}
    beats = [m for m in frames if m.get_type() == "HEARTBEAT"]
    assert {(m.type, m.autopilot) for m in beats} == {(18, 8)}
    assert len(beats) >= 6
    assert 3 <= kinds["TIMESYNC"] / len(beats) <= 7  # five a second
    commands = [m for m in frames if m.get_type() == "COMMAND_LONG"]
    assert {m.command for m in commands} == {511}
    assert {(m.target_system, m.target_component) for m in commands} == {(1, 1)}
    wanted = {int(m.param1): m.param2 for m in commands}
    assert wanted[dialect.MAVLINK_MSG_ID_GPS_RAW_INT] == pytest.approx(50_000)
    assert wanted[dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED] == pytest.approx(10_000)
    assert len(commands) == asked  # what is fast enough is not asked for again


def queried(endpoint: str, key: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """(value, attachment) of a reply."""
    config = zenoh.Config()
    for name, value in (
        ("mode", '"client"'),
        ("connect/endpoints", json.dumps([endpoint])),
        ("scouting/multicast/enabled", "false"),
    ):
        config.insert_json5(name, value)
    with zenoh.open(config) as session:
        (reply,) = list(session.get(key, timeout=10.0))
        ok = reply.ok
        return json.loads(ok.payload.to_bytes()), json.loads(ok.attachment.to_bytes())


def test_daemon_survives_a_reboot_of_the_autopilot_seeds_3_and_4(setup: Setup) -> None:
    """The simulator is killed and started again: nothing valid is to be had meanwhile, then a new track."""
    links = ("--mavlink", f"udpout:127.0.0.1:{setup.autopilot}", "--tcp", "none", "--zenoh", setup.endpoint)
    key = "onboard/1/estimate/leader"
    with setup.daemon(f"udpin:127.0.0.1:{setup.autopilot}") as daemon:
        observer = setup.observer()
        with setup.simulator(*links, "--wait", "15", seed=3) as simulator:
            until(observer.is_tracking, "a track")
            value, attachment = queried(setup.endpoint, key)
            assert value["valid"] is True
            assert attachment["stale"] is False
            begun = observer.estimates[-1].t_ns
            # so that the boot clock goes back by more than a second when it begins anew
            until(lambda: observer.is_tracking() and observer.estimates[-1].t_ns > begun + 3e9, "three seconds")
            simulator.end(signal.SIGKILL)
        daemon.wait_for("the autopilot is silent")
        value, attachment = queried(setup.endpoint, key)
        assert (value["valid"], value["state"]) == (False, "lost")
        assert attachment["stale"] is True
        assert attachment["age_s"] > 2
        observer.look()
        before = len(observer.estimates)
        with setup.simulator(*links, "--wait", "15", log="again.log", seed=4):
            daemon.wait_for("has rebooted")
            daemon.wait_for("the autopilot is heard again")
            until(observer.is_tracking, "a new track")
            assert len(observer.estimates) > before

            def counted() -> bool:
                observer.look()
                return observer.newest().autopilot_reboots == 1

            until(counted, "the reboot in the health")
        assert daemon.end() == 0
    assert "Traceback" not in daemon.said()
    new = observer.estimates[before:]
    assert any(not e.valid for e in new[:50])
    assert new[-1].reset_count > observer.estimates[before - 1].reset_count


def test_two_daemons_on_one_port_the_second_says_which(setup: Setup) -> None:
    url = f"udpin:127.0.0.1:{setup.autopilot}"
    with setup.daemon(url) as first:
        same_udp = run(
            "onboard", "run", "--set", f"link=[{{name='a', url='{url}'}}]", "--set", "zenoh.enabled=false"
        )
        same_zenoh = run("onboard", "run", "--set", "link=[]", "--set", f"zenoh.listen=['{setup.endpoint}']")
        assert first.end() == 0
    for done, what in ((same_udp, url), (same_zenoh, setup.endpoint)):
        assert done.returncode == 2
        (line,) = [text for text in done.stderr.splitlines() if text.startswith("onboard:")]
        assert what in line
        assert "Traceback" not in done.stderr


def test_recording_is_never_overwritten_and_a_bad_folder_is_said_at_once(setup: Setup) -> None:
    recording = setup.folder / "flight.mcap"
    recording.write_bytes(b"precious")
    url = f"udpin:127.0.0.1:{setup.autopilot}"
    with setup.daemon(url, f"recorder.path='{recording}'") as daemon:
        until((setup.folder / "flight-2.mcap").exists, "the recording")
        assert daemon.end() == 0
    assert recording.read_bytes() == b"precious"
    done = run("onboard", "run", "--set", f"recorder.path='{recording}/x.mcap'", "--set", "zenoh.enabled=false")
    assert done.returncode == 2
    assert f"cannot record to {recording}/x.mcap" in done.stderr

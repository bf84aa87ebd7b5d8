"""`onboard status` and `onboard check` of healths made by hand, and of a computer on which no daemon answers."""

import errno
import shutil
import socket
from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from msgspec.structs import replace

from onboard.commands import absent, readiness, status
from onboard.commands.absent import why_absent
from onboard.commands.readiness import judged
from onboard.commands.status import describe
from onboard.config import Config, load_config
from onboard.health.causes_host import MIN_STORAGE_BYTES
from onboard.messages import (
    NO_REASON,
    Advice,
    CameraHealth,
    Cause,
    Consistency,
    Health,
    Lifecycle,
    LinkHealth,
    Reason,
    Refusal,
    Severity,
    SinkHealth,
    StreamHealth,
)
from onboard.messages.health import ComputerLoad
from onboard.pipeline import Pipeline
from onboard.sinks.recorder import MIN_UNIX_TIME_S
from onboard.view.client import PublishedRecord
from tests.support.daemon import UDP
from tests.support.golden import assert_golden

S = 1_000_000_000
NEEDED = {"Attitude": 10.0, "LocalPosition": 10.0}


def advice(kind: str, severity: Severity = Severity.ERROR, **changed: Any) -> Advice:
    fields = {"about": "x", "what": f"{kind} is wrong", "remedy": f"mend {kind}", "text": "x"} | changed
    return Advice(kind=kind, severity=severity, **fields)


def healthy(config: Config) -> Health:
    """Of a daemon that hears all it needs."""
    return replace(
        Pipeline(config).health(100 * S),
        uptime=61.4,
        autopilot="PX4, system 1",
        followed="1/1",
        links={"autopilot": LinkHealth(received=900, sent=9, errors=1, dropped=2, shed=3)},
        streams={
            **{name: StreamHealth(count=100, rate=50.0, age=0.01) for name in NEEDED},
            "Imu": StreamHealth(count=9, rate=8.0, age=1.25),
        },
        needed=NEEDED,
        cameras={"front": CameraHealth(count=90, rate=30.0, age=0.02)},
        clock_source="timesync",
        round_trip=0.0012,
        advice=(),
    )


def rich(config: Config) -> Health:
    """Of one that has everything to tell."""
    refusals = (
        Refusal(source=f"camera {k}", reason="no `t_ns`", count=k, t_recv_ns=(90 + k) * S) for k in range(7)
    )
    return replace(
        healthy(config),
        advice=(
            advice("mount", count=3),
            advice("timesync", Severity.NOTICE, remedy=""),
            advice("slow", Severity.WARNING),
        ),
        beside=("ArduPilot, system 2", "PX4, system 3"),
        autopilot_reboots=2,
        senders={"2/1": 7, "1/1": 300},
        clock_offset_ns=1_500_400_000,
        clock_rate=1.00012,
        needed=NEEDED | {"GpsFix": 2.5},
        cameras={
            "front": replace(
                healthy(config).cameras["front"], latency=0.0571, lead=-0.012, clock="host", targets=("", "leader")
            ),
            "left": CameraHealth(count=9, rate=5.06, age=1.0, classes=("drone", "bird")),
        },
        states={"leader": Lifecycle.COASTING, "own_state": Lifecycle.TRACKING},
        reasons={"leader": "no image for 1 s"},
        consistency={"leader.front": Consistency(count=40, nis=1.238, low=0.6, high=1.5, noise=1.26)},
        rejected={"of another system": 4, "crc": 11},
        refusals=tuple(refusals),
        sinks={"zenoh": SinkHealth(sent=90, dropped=10), "recorder": SinkHealth(error="disk full")},
        computer=ComputerLoad(
            cpu=12.4, cpu_busiest=55.5, memory_free=1_250_000_000, storage_free=9_040_000_000, lag=0.0124
        ),
    )


@pytest.fixture
def config() -> Config:
    return load_config(None, ("estimator.leader.size_prior_m=2.0",))


def test_all_that_a_health_tells(config: Config) -> None:
    bare = replace(Pipeline(config).health(1), clock_source="none", computer=ComputerLoad(cpu=3.0))
    shown = {"rich": rich(config), "healthy": healthy(config), "bare": bare}
    lines = [text for name, health in shown.items() for text in (describe(name, health), "")]
    for name, health in shown.items():
        lines += [f"check {name}", *map(str, judged(config, health, "this check"))]
    offset = replace(healthy(config), round_trip=None, clock_offset_ns=5, clock_source="arrivals")
    traffic = load_config(None, ("estimator.traffic.filter=kf",))
    lines += ["check of no leader", *map(str, judged(traffic, replace(offset, cameras={}), "a daemon"))]
    assert_golden("health.txt", lines)


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"followed": ""}, "autopilot"),
        ({"streams": {"Attitude": StreamHealth(count=9, rate=50.0, age=0.0)}}, "rates"),
        ({"streams": {name: StreamHealth(count=9, rate=7.9, age=0.0) for name in NEEDED}}, "rates"),
        ({"streams": {name: StreamHealth(count=9, rate=8.0, age=0.0) for name in NEEDED}}, ""),
        ({"cameras": {}}, "camera"),
        ({"links": {"autopilot": LinkHealth(error="no such device")}}, "links"),
        *(
            ({"advice": (advice(kind),)}, topic)
            for topic, kinds in (*readiness.TOPICS.items(), ("never heard of", ("never heard of",)))
            for kind in kinds
        ),
        ({"advice": (advice("mount", Severity.WARNING),)}, ""),
    ],
)
def test_what_is_missing_fails_its_line_alone(config: Config, change: dict[str, object], line: str) -> None:
    lines = [*judged(config, replace(healthy(config), **change), "a daemon")]
    assert [one.name for one in lines if one.is_needed] == [line] * bool(line)


def test_disk_and_clock(config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    free = [
        7_250_000_000,
        7_250_000_000,
        7_250_000_000,
        MIN_STORAGE_BYTES - 1,
        MIN_STORAGE_BYTES,
    ]
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=free.pop(0)))
    lines = [str(readiness._disk(config))]
    for path in ("here.mcap", "logs/a/here.mcap", "/nowhere/a/flight.mcap", "full.mcap", "just.mcap"):
        lines += [str(readiness._disk(load_config(None, (f"recorder.path={path}",))))]

    def fails(_: Path) -> None:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(shutil, "disk_usage", fails)
    lines += [str(readiness._disk(load_config(None, ("recorder.path=a.mcap",))))]
    signed = replace(config, link=(replace(config.link[0], key_file="key"),))
    secret = replace(config, zenoh=replace(config.zenoh, ca_file="ca.pem"))
    for one, t in ((config, MIN_UNIX_TIME_S), (config, 1e6), (signed, 1e6), (secret, 1e6), (signed, 2e9)):
        lines += [str(readiness._clock(one, t))]
    assert_golden("disk_and_clock.txt", (line.replace(str(tmp_path), "HERE") for line in lines))


@pytest.fixture
def processes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Path, int, int]]:
    """A /proc whose program 77 has a UDP and program 78 a TCP port; both ports are in use."""
    with socket.socket(socket.AF_INET, UDP) as udp, socket.create_server(("127.0.0.1", 0)) as tcp:
        udp.bind(("127.0.0.1", 0))
        ports = udp.getsockname()[1], tcp.getsockname()[1]
        (tmp_path / "net").mkdir()
        head = "sl local_address rem_address st tx_queue tr tm->when retrnsmt uid timeout inode\n"
        for protocol, port, inode in zip(("udp", "tcp"), ports, (4711, 4712), strict=True):
            rows = [
                f"0: 0100007F:{port:04X} 0 {state} 0 0 0 0 0 {number}\n"
                for state, number in (("01", 1), ("0A", inode))
            ]
            (tmp_path / "net" / protocol).write_text(head + "".join(rows))
        for number, name, inode, words in (
            (77, "detector", 4711, "python run"),
            (78, "onboard", 4712, "/x/onboard run c"),
        ):
            (tmp_path / str(number) / "fd").mkdir(parents=True)
            (tmp_path / str(number) / "fd" / "3").symlink_to(f"socket:[{inode}]")
            (tmp_path / str(number) / "comm").write_text(f"{name}\n")
            (tmp_path / str(number) / "cmdline").write_text(words.replace(" ", "\0"))
        monkeypatch.setattr(absent, "PROC", tmp_path)
        yield tmp_path, *ports


def test_why_no_daemon_answers(processes: tuple[Path, int, int], monkeypatch: pytest.MonkeyPatch) -> None:
    proc, udp, tcp = processes
    usage = [SimpleNamespace(free=MIN_STORAGE_BYTES - n) for n in (1, 0)]
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage.pop(0) if usage else SimpleNamespace(free=1 << 40))
    unreachable, tls = Reason(Cause.UNREACHABLE, "refused"), Reason(Cause.TLS, "expired")
    used = [f"link=[{{name='a', url='udpin:127.0.0.1:{udp}'}}]", f"zenoh.listen=['tcp/127.0.0.1:{tcp}']"]
    cases = {
        "unread": (why_absent(Config(), "E", unreachable, unread=3)),
        "other vehicle": (why_absent(Config(), "E", NO_REASON, "uav-7")),
        "no health": (why_absent(Config(), "E", NO_REASON)),
        "nothing": (why_absent(load_config(None, ("zenoh.listen=['udp/127.0.0.1:9']",)), "E", unreachable)),
        "asks nobody": (why_absent(load_config(None, ("link=[]", "zenoh.listen=[]")), "E", unreachable)),
        "without Zenoh": (why_absent(load_config(None, ("link=[]", "zenoh.enabled=false")), "E", unreachable)),
        "certificates": (why_absent(load_config(None, ("link=[]",)), "E", tls)),
        "link": (why_absent(load_config(None, (used[0], "zenoh.enabled=false")), "E", unreachable)),
        "both": (why_absent(load_config(None, tuple(used)), "E", unreachable)),
        "camera": (why_absent(load_config(None, (used[0].replace("udpin", "json"),)), "E", unreachable)),
        "server": (
            why_absent(load_config(None, (f"link=[{{name='a', url='tcpin:127.0.0.1:{tcp}'}}]",)), "E", tls)
        ),
        "full disk": (why_absent(load_config(None, ("link=[]", "recorder.path=/tmp/a.mcap")), "E", unreachable)),
        "room": (why_absent(load_config(None, ("link=[]", "recorder.path=/tmp/a.mcap")), "E", unreachable)),
        "no room": (why_absent(load_config(None, ("link=[]", "recorder.path=/proc/1/a.mcap")), "E", unreachable)),
    }
    shutil.rmtree(proc / "77")
    cases["nobody"] = why_absent(load_config(None, (used[0],)), "E", unreachable)
    lines = [f"{name}: {a.kind} | {a.what} | {a.remedy}" for name, found in cases.items() for a in found]
    assert_golden("absent.txt", (line.replace(str(udp), "UDP").replace(str(tcp), "TCP") for line in lines))


@pytest.mark.parametrize(("as_json", "is_terminal"), [(False, True), (False, False), (True, True)])
def test_a_watched_health_is_shown_whenever_it_comes(
    as_json: bool,
    is_terminal: bool,
    config: Config,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    taken: list[PublishedRecord | None] = [PublishedRecord(healthy(config), 1, "1"), None]
    taken += [PublishedRecord("no health", 1, "1"), PublishedRecord(rich(config), 1, "2")]

    def take(_: float) -> PublishedRecord | None:
        if not taken:
            raise KeyboardInterrupt
        return taken.pop(0)

    monkeypatch.setattr("sys.stdout.isatty", lambda: is_terminal, raising=False)
    client, arguments = SimpleNamespace(take=take, unread=0), Namespace(watch=True, json=as_json, vehicle=None)
    with pytest.raises(KeyboardInterrupt):
        status._watch(client, arguments, config, "E")
    shown = capsys.readouterr().out
    assert shown.count(status.CLEAR) == (2 if is_terminal and not as_json else 0)
    assert shown.count('"healthy":true' if as_json else "vehicle 1: healthy") == 2
    assert shown.count('"healthy":false' if as_json else "vehicle 2: NOT HEALTHY") == 1

"""`onboard status`: of a daemon that answers, and of none."""

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec
import pytest
from msgspec.structs import replace

from onboard.commands import cli
from onboard.config import Config
from onboard.messages import Advice, Health, Severity
from onboard.pipeline import Pipeline
from onboard.sinks.zenoh_session import ZenohConfig, open_session
from tests.support.daemon import TCP
from tests.support.programs import free_ports

ADVICE = Advice(
    cause="camera-silent",
    severity=Severity.ERROR,
    about="camera front",
    what="camera front: no image has come",
    remedy="start the detector",
    text="camera front: no images",
)


@contextmanager
def publishing(health: Health | dict[str, int], vehicles: tuple[str, ...] = ("1",)) -> Iterator[str]:
    """A daemon's or router's endpoint, at which this health of each vehicle is published ten times a second."""
    (port,) = free_ports(TCP)
    endpoint = f"tcp/127.0.0.1:{port}"
    session, stop = open_session(ZenohConfig(listen=(endpoint,))), threading.Event()

    def publish() -> None:
        while not stop.wait(0.1):
            for vehicle in vehicles:
                session.put(f"onboard/{vehicle}/health", msgspec.json.encode(health))

    thread = threading.Thread(target=publish)
    thread.start()
    try:
        yield endpoint
    finally:
        stop.set()
        thread.join()
        session.close()


def test_a_daemon_whose_records_cannot_be_read_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    with publishing({"of": 9}) as endpoint:
        assert cli.main(["status", "--connect", endpoint, "--json"]) == 1
        assert f"records from {endpoint} cannot be read: a daemon of another version" in capsys.readouterr().out


@pytest.mark.parametrize(("advice", "code"), [((), 0), ((ADVICE,), 1)])
def test_the_exit_code_says_whether_all_is_well(
    advice: tuple[Advice, ...], code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    health = replace(Pipeline(Config()).health(1), advice=advice)
    with publishing(health) as endpoint:
        assert cli.main(["status", "--connect", endpoint]) == code
        shown = capsys.readouterr().out
        assert shown.startswith(f"vehicle 1: {'NOT HEALTHY' if code else 'healthy'}")
        assert ("-> start the detector" in shown) is bool(code)
        assert cli.main(["status", "--connect", endpoint, "--json"]) == code
    document = json.loads(capsys.readouterr().out)
    assert document["healthy"] is not bool(code)
    assert [a["cause"] for a in document["health"]["advice"]] == [a.cause for a in advice]


@pytest.mark.parametrize("asked", [(), ("--vehicle", "all")])
def test_all_vehicles_of_a_router_are_shown(asked: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    """The first one that was heard was shown alone."""
    with publishing(Pipeline(Config()).health(1), ("1", "uav-2", "uav-3")) as endpoint:
        assert cli.main(["status", "--connect", endpoint, *asked]) == 0
    shown = [line for line in capsys.readouterr().out.splitlines() if line.startswith("vehicle ")]
    assert [line.partition(":")[0] for line in shown] == ["vehicle 1", "vehicle uav-2", "vehicle uav-3"]


def test_the_own_daemon_is_asked_while_its_router_is_off(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (port,) = free_ports(TCP)
    with publishing(Pipeline(Config()).health(1)) as endpoint:
        config = tmp_path / "c.toml"
        config.write_text(f'[zenoh]\nlisten = ["{endpoint}"]\nconnect = ["tcp/127.0.0.1:{port}"]\n')
        assert cli.main(["status", "--config", str(config)]) == 0
        config.write_text(f'[zenoh]\nlisten = ["tcp/127.0.0.1:{port}"]\nconnect = ["{endpoint}"]\n')
        assert cli.main(["status", "--config", str(config)]) == 0
        config.write_text(f'[zenoh]\nlisten = []\nconnect = ["tcp/127.0.0.1:{port}"]\n')
        assert cli.main(["status", "--config", str(config)]) == 1
    assert "lets this computer ask its own daemon" in capsys.readouterr().out


def test_what_is_published_in_a_vehicle_s_name_controls_no_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    """Any client of the router may publish a health with any text in it."""
    evil = "PX4\x1b[2J\u202e\nvehicle 1: healthy"
    with publishing(replace(Pipeline(Config()).health(1), autopilot=evil)) as endpoint:
        cli.main(["status", "--connect", endpoint])
        shown = capsys.readouterr().out
        assert "autopilot  PX4?[2J??vehicle 1: healthy; reboots 0" in shown.split("\n")
        cli.main(["status", "--connect", endpoint, "--json"])
        assert json.loads(capsys.readouterr().out)["health"]["autopilot"] == "PX4?[2J??vehicle 1: healthy"

"""`onboard check`: a line for each thing that a flight needs, and exit code 1 if one of them is missing."""

import socket
from pathlib import Path

import pytest
from msgspec.structs import replace

from onboard.commands import cli, readiness
from onboard.compiled.machine import REPAIR, MachineCodeError
from onboard.config import Config, load_config
from tests.support.daemon import TCP, UDP, Setup
from tests.support.programs import free_ports
from tests.unit.commands.test_health_shown import healthy
from tests.unit.commands.test_status import publishing


@pytest.fixture
def config() -> Config:
    return load_config(None, ("estimator.leader.size_prior_m=2.0",))


@pytest.mark.parametrize("fine", [True, False])
def test_a_daemon_that_runs_is_asked(
    fine: bool, config: Config, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With its ports in use, no second one could listen."""
    health = healthy(config) if fine else replace(healthy(config), followed="")
    with socket.socket(socket.AF_INET, UDP) as taken, publishing(health) as endpoint:
        taken.bind(("127.0.0.1", 0))
        file = tmp_path / "c.toml"
        url = f"udpin:127.0.0.1:{taken.getsockname()[1]}"
        file.write_text(
            f'[[link]]\nname = "autopilot"\nurl = "{url}"\n[estimator.leader]\n[zenoh]\nlisten = ["{endpoint}"]\n'
        )
        assert cli.main(["check", str(file)]) == (0 if fine else 1)
    shown = capsys.readouterr().out
    assert "heard by a daemon that runs" in shown or not fine
    assert ("FAIL autopilot" in shown) is not fine


def test_a_port_that_another_program_has_is_one_line_with_its_name(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket(socket.AF_INET, UDP) as taken:
        taken.bind(("127.0.0.1", 0))
        link = f"link=[{{name='autopilot', url='udpin:127.0.0.1:{taken.getsockname()[1]}'}}]"
        assert cli.main(["check", "--set", link, "--set", "zenoh.enabled=false"]) == 1
    shown = capsys.readouterr().out
    assert "FAIL links" in shown
    assert "cannot listen" in shown
    assert "is in use by" in shown


def test_nothing_is_heard_and_it_ends(capsys: pytest.CaptureFixture[str]) -> None:
    (port,) = free_ports(TCP)
    sets = ("link=[{name='a', url='udpin:127.0.0.1:0'}]", f"zenoh.listen=['tcp/127.0.0.1:{port}']")
    arguments = [a for setting in sets for a in ("--set", setting)]
    assert cli.main(["check", "--wait", "0.5", *arguments]) == 1
    shown = capsys.readouterr().out
    assert "listening for at most 0.5 s" in shown
    assert "FAIL autopilot   none is heard" in shown


def test_who_listens_leads_no_vehicle_and_writes_nothing(tmp_path: Path) -> None:
    sets = ("leader_out=[{link='autopilot'}]", "odometry.link=autopilot", "traffic_out.link=autopilot")
    files = (
        f"recorder.path={tmp_path}/x.mcap",
        f"parameters.path={tmp_path}/x.toml",
        "estimator.leader.size_prior_m=2",
    )
    quiet = readiness._quiet(load_config(None, (*sets, *files)))
    assert (quiet.leader_out, quiet.odometry.link, quiet.traffic_out.link) == ((), None, "")
    assert (quiet.recorder.path, quiet.parameters.path, quiet.warm_start.enabled) == (None, None, False)
    assert "leader" in quiet.estimator


@pytest.mark.slow  # beside the daemon that is asked
def test_a_simulated_flight_is_ready_and_nothing_is_recorded(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    setup = Setup(tmp_path)
    url = f"udpin:127.0.0.1:{setup.autopilot}"
    sets = (*setup.settings(url, f"recorder.path='{tmp_path}/flight.mcap'"), "leader_out=[{link='autopilot'}]")
    links = ("--mavlink", f"udpout:127.0.0.1:{setup.autopilot}", "--tcp", "none", "--zenoh", "none")
    links += ("--camera", "mavlink", "--camera-mavlink", f"udpout:127.0.0.1:{setup.camera}")
    with setup.simulator(*links):
        arguments = [a for setting in sets for a in ("--set", setting)]
        code = cli.main(["check", str(setup.config), "--wait", "120", *arguments])
    shown = capsys.readouterr().out
    assert "FAIL" not in shown, shown
    assert code == 0
    assert "PX4, system 1" in shown
    assert "round trip" in shown
    assert not (tmp_path / "flight.mcap").exists()


def test_missing_machine_code_is_one_line_with_the_remedy(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def load(*_: object) -> None:
        raise MachineCodeError(f"there is none; {REPAIR}")

    monkeypatch.setattr("onboard.commands.readiness.load", load)
    assert cli.main(["check"]) == 1
    assert capsys.readouterr().out == f"FAIL filters     there is none; {REPAIR}\n"

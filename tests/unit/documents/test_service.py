"""configs/onboard.service: commands that we have, the priority that the daemon takes by itself, and what systemd
says of it."""

import configparser
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from onboard.commands.loading import NICE
from tests.support.programs import ROOT

UNIT = (ROOT / "configs" / "onboard.service").read_text(encoding="utf-8")
SYSTEMD = shutil.which("systemd-analyze")


def service() -> configparser.SectionProxy:
    """Its section on the service."""
    parser = configparser.ConfigParser(
        interpolation=None, strict=False
    )  # DeviceAllow stands there for each device
    parser.optionxform = str  # keys keep their capitals
    parser.read_string(UNIT)
    return parser["Service"]


def test_it_starts_a_command_that_we_have_and_after_a_crash_at_once() -> None:
    assert "ExecStartPre" not in service()
    assert service()["RestartSec"] == "100ms"
    assert (service()["Type"], service()["WatchdogSec"]) == ("notify", "10s")
    assert "time-sync" not in UNIT
    program, command, config = shlex.split(service()["ExecStart"])
    assert Path(program).name == "onboard"
    assert Path(config).is_absolute()
    helped = [sys.executable, "-m", "onboard", command, "--help"]
    assert "TOML" in subprocess.run(helped, capture_output=True, text=True, check=True, timeout=60).stdout


def test_its_priority_is_the_daemons() -> None:
    assert int(service()["Nice"]) == NICE


@pytest.mark.skipif(SYSTEMD is None, reason="systemd-analyze is not installed")
def test_systemd_understands_every_line(tmp_path: Path) -> None:
    unit = tmp_path / "onboard.service"
    unit.write_text(re.sub(r"/opt/wingline/bin/onboard", sys.executable, UNIT), encoding="utf-8")
    said = subprocess.run([SYSTEMD, "verify", str(unit)], capture_output=True, text=True, check=False, timeout=60)
    assert (said.returncode, said.stderr) == (0, "")
    security = [SYSTEMD, "security", "--offline=true", "--threshold=30", str(unit)]
    assert subprocess.run(security, capture_output=True, check=False, timeout=60).returncode == 0, "exposure > 3.0"

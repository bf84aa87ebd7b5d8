"""`onboard study --all`: every study from its flights to its report, as small as each can be, so that none breaks
unnoticed. The tests of each study check its results."""

import json
import os
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib
import msgspec
import pytest

from onboard.commands import study as command
from onboard.commands.cli import main
from onboard.studies.csvsf_quadrotor import study as csvsf_quadrotor
from onboard.studies.csvsf_quadrotor.filters import ADAPTIVE
from onboard.studies.encounters import flights as encounters
from onboard.studies.own_state import flights as own_state
from onboard.studies.relative_motion import study as relative_motion
from onboard.studies.relative_motion.variants import Variant, scenario_of
from onboard.studies.together import run_study
from onboard.studies.traffic import study as traffic
from simlink.scenarios.scenario import Scenario


def _one_after_another(
    names: Sequence[str], seeds: int | None, out: Path, on_progress: Callable[[str, int, int], None]
) -> dict[str, dict[str, Any]]:
    """As `run_all`, but in this process, where the flights are made shorter."""
    return {name: run_study(name, seeds, out, partial(on_progress, name)) for name in names}


def _shorter(variant: Variant) -> Scenario:
    return msgspec.structs.replace(scenario_of(variant), duration=17.0)


@pytest.mark.timeout(400)
def test_every_study_flies_and_writes_its_report_one_seed_each(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command, "run_all", _one_after_another)
    monkeypatch.setattr(os, "cpu_count", lambda: 1)
    monkeypatch.setitem(matplotlib.rcParams, "savefig.dpi", 20)
    monkeypatch.setattr(relative_motion, "scenario_of", _shorter)
    monkeypatch.setattr(csvsf_quadrotor, "run", partial(csvsf_quadrotor.run, settings=(ADAPTIVE,)))
    monkeypatch.setattr(csvsf_quadrotor, "simulate", partial(csvsf_quadrotor.simulate, steps=1500))
    monkeypatch.setattr(encounters, "SECONDS", 7.0)
    monkeypatch.setattr(own_state, "FAULT_AT", 0.5)
    monkeypatch.setattr(own_state, "SECONDS", 1.5)
    monkeypatch.setattr(own_state, "LONG_SECONDS", {})
    monkeypatch.setattr(traffic, "fly", partial(traffic.fly, duration=12.0))
    numbers = tmp_path / "all.json"
    assert main(["study", "--all", "--seeds", "1", "--out", str(tmp_path), "--json", str(numbers)]) == 0
    names = command.study_names()
    assert len(names) >= 8
    assert sorted(json.loads(numbers.read_bytes())) == names
    for name in names:
        assert json.loads((tmp_path / name / "result.json").read_bytes())["seeds"] == 1
        assert len((tmp_path / name / "report.md").read_text(encoding="utf-8").splitlines()) > 10
    table = capsys.readouterr().out
    assert all(name in table for name in names)

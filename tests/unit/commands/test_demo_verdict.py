"""What the demo's exit code says, of flights that were not flown."""

import argparse
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from onboard.commands import demo
from onboard.commands.demo_flight import DemoReport, Drops, flown_beside
from onboard.config import parse_config
from onboard.scoring.leader import score_leader
from onboard.scoring.own_state import OwnStateScore
from onboard.scoring.statistics import Latency

OWN = OwnStateScore(
    states=1,
    valid=1,
    settle_s=10.0,
    valid_percent=100.0,
    velocity_rmse_m_s=0.1,
    attitude_rmse_deg=0.1,
    inside_3_sigma_percent=100.0,
    nees_mean=6.0,
    nees_dof=6,
    nees_bounds=(1.24, 14.45),
    nis_ratio=1.0,
    resets=0,
    faults=(),
)


def exit_code(
    monkeypatch: pytest.MonkeyPatch,
    folder: Path,
    *,
    diverged: bool,
    images: int,
    own: OwnStateScore | None,
    wrong: float | None = None,
) -> int:
    report = DemoReport(
        scenario="formation",
        seed=1,
        duration_s=5.0,
        score=replace(score_leader([], None), diverged=diverged, confidently_wrong_percent=wrong),
        latency_ms=Latency(),
        drops=Drops(
            images_sent=images, images_received=images, images_lost=0, estimates_missed=0, sink_drops=0, skipped=0
        ),
        own_state=own,
    )

    def flown(**_: Any) -> DemoReport:
        return report

    monkeypatch.setattr(demo, "run_demo", flown)
    arguments = argparse.Namespace(
        detector=None,
        beside=None,
        scenario="formation",
        seed=1,
        duration=5.0,
        out=folder,
        set=[],
        json=folder / "score.json",
        headless=True,
    )
    return demo.main(arguments)


@pytest.mark.parametrize("own", [None, OWN])
def test_a_demo_that_diverged_fails(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, own: OwnStateScore | None
) -> None:
    assert exit_code(monkeypatch, tmp_path, diverged=True, images=100, own=own) == 1
    assert exit_code(monkeypatch, tmp_path, diverged=False, images=100, own=own) == 0
    assert (tmp_path / "score.json").exists()


def test_a_demo_without_a_leader_to_be_seen_is_judged_by_none(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert exit_code(monkeypatch, tmp_path, diverged=True, images=0, own=OWN) == 0
    assert exit_code(monkeypatch, tmp_path, diverged=True, images=0, own=None) == 1


@pytest.mark.parametrize(("wrong", "code"), [(None, 0), (49.0, 0), (51.0, 1)])
def test_a_demo_that_is_confidently_wrong_most_of_the_time_fails(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, wrong: float | None, code: int
) -> None:
    assert exit_code(monkeypatch, tmp_path, diverged=False, images=100, own=OWN, wrong=wrong) == code


@pytest.mark.parametrize(("valid", "code"), [(None, 0), (51.0, 0), (49.0, 1)])
@pytest.mark.parametrize("images", [0, 100])
def test_a_vehicle_whose_own_state_is_hardly_ever_valid_fails(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, valid: float | None, code: int, images: int
) -> None:
    """Alone or behind a leader, whose estimate fails only where there is one."""
    own = replace(OWN, valid_percent=valid)
    assert exit_code(monkeypatch, tmp_path, diverged=not images, images=images, own=own) == code


def test_a_filter_beside_is_given_the_leader_s_wingspan() -> None:
    setting = flown_beside("paper", parse_config({"estimator": {"leader": {"size_prior_m": 2.667}}}))
    assert setting == "estimator.oh_johnson={size_prior_m=2.667}"

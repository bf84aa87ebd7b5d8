"""`onboard demo` with its default flight and an earlier fault, in real time.

Both estimators run from bytes to the scorecard, its JSON and the recording of the view.
"""

import json
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from tests.support import documents
from tests.support.programs import run
from tests.support.view_flight import rows_of

# In real time, with two estimators: what it shows is asserted without a clock in test_both_estimators.
pytestmark = pytest.mark.slow

DURATION_S = 21
EARLY = (
    "extends = 'mission'\n[quadrotor.fault]\nat = 16.0\n[quadrotor.gust]\nwhen = { start = 11.0, end = 13.0 }\n"
)


class Flown(NamedTuple):
    numbers: dict[str, Any]
    stdout: str
    out: Path


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Flown:
    folder = tmp_path_factory.mktemp("mission")
    scenario = folder / "early.toml"
    scenario.write_text(EARLY)
    done = run(
        *("onboard", "demo", "--headless", "--scenario", scenario, "--duration", DURATION_S, "--seed", 1),
        *("--json", folder / "score.json", "--out", folder / "out"),
    )
    assert done.returncode == 0, done.stderr
    return Flown(json.loads((folder / "score.json").read_bytes()), done.stdout, folder / "out")


def test_the_leader_is_valid_and_our_own_state_honest_seed_1(flown: Flown) -> None:
    assert flown.numbers["diverged"] is False
    assert flown.numbers["valid_percent"] >= 97.0
    assert 0 < flown.numbers["range_error_rms_percent"] <= 3.0
    assert flown.numbers["inside_95_percent"] >= 93.0
    own = flown.numbers["own_state"]
    assert own["valid_percent"] >= 97.0
    assert 0 < own["velocity_rmse_m_s"] <= 0.15
    low, high = own["nees_bounds"]
    assert low < own["nees_mean"] < high


def test_the_weak_motor_is_named_within_a_second_and_nothing_else_seed_1(flown: Flown) -> None:
    fault = flown.numbers["fault"]
    assert (fault["happened"], fault["named"], fault["wrong"]) == ("motor 1", "motor 1", [])
    assert 0 < fault["after_s"] <= 1.0
    assert fault["magnitude"] == pytest.approx(0.25, abs=0.05)
    assert f"motor 1 ({fault['magnitude']:.2f})" in flown.stdout
    assert f"{flown.numbers['own_state']['velocity_rmse_m_s']:.3f} m/s" in flown.stdout


def test_all_documented_keys_are_there(flown: Flown) -> None:
    nested = {"own_state", "fault"}
    assert documents.keys_of(flown.numbers) == documents.scorecard_keys("demo") - nested


def test_the_view_has_both(flown: Flown) -> None:
    rows = rows_of(flown.out / "early-1.rrd")
    for entity in (
        "/scene/uncertainty/ellipsoid",
        "/rotors/discs",
        "/plots/own/velocity_error/error",
        "/own_banner/words",
    ):
        assert rows.get(entity, 0) > 50, entity
    assert rows["/faults"] >= 3  # none, the gust, none or the motor

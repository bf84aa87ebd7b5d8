"""A quadrotor sees a leader: both estimators in one pipeline, and a motor that weakens.

The noise is that of the quadrotor's own sensors; the fault comes at 18 s instead of the scenario's 30. Seeds stand
in the names.
"""

from typing import Any

import numpy as np
import pytest

from onboard.estimators.own_state.estimator import Estimator
from onboard.messages import FaultKind, NavState
from tests.support.cases import slow_but
from tests.support.scenarios import Flights, Replayed

FAULT_TIME_S = 18
DURATION_S = 21.0
TO_OWN_STATE = "attitude_from_own_state.own_state_is_surer"


@pytest.fixture(scope="module")
def mission(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The scenario, by its file."""
    path = tmp_path_factory.mktemp("mission") / "early.toml"
    path.write_text(f'extends = "mission"\n[quadrotor.fault]\nat = {FAULT_TIME_S}.0\n', encoding="utf-8")
    return str(path)


@pytest.fixture(scope="module")
def flights(tmp_path_factory: pytest.TempPathFactory) -> Flights:
    return Flights(tmp_path_factory.mktemp("both"), 1)


def assert_followed(run: Replayed) -> None:
    """The leader is valid, near and honest, from 15 s on."""
    assert run.score.valid_percent is not None
    assert run.score.inside_95_percent is not None
    assert run.score.range_error_rms_percent is not None
    assert run.score.valid_percent >= 97.0
    assert run.score.inside_95_percent >= 93.0
    assert run.score.range_error_rms_percent <= 2.5  # the size is off by as much
    assert run.score.verdicts.get("gated", 0) < 0.05 * run.score.verdicts["fused"]
    assert not run.score.diverged
    assert run.errors == []


@pytest.mark.parametrize("source", slow_but(["auto"], ["auto", "autopilot"]))
def test_the_leader_is_followed_by_a_quadrotor_with_its_own_noise_seed_1(
    flights: Flights, mission: str, source: str
) -> None:
    run = flights(mission, f"ownship.source={source}", until=DURATION_S)
    assert_followed(run)
    assert run.health.own_motion_sources == ({TO_OWN_STATE: 1} if source == "auto" else {})


def test_our_own_state_is_honest_and_names_the_motor_seed_1(flights: Flights, mission: str) -> None:
    run = flights(mission, "ownship.source=auto", until=DURATION_S)
    ratios = [o.nis_ratio for o in run.own if o.nis_ratio is not None and o.t_ns > run.boot_ns + 10 * 10**9]
    assert 0.5 < np.mean(ratios) < 1.5
    named = [f for f in run.own[-1].faults if f.kind is FaultKind.MOTOR]
    assert [f.part for f in named] == ["motor 1"]
    before = {f.kind for o in run.own if o.t_ns < run.boot_ns + FAULT_TIME_S * 10**9 for f in o.faults}
    assert before == set()


def test_an_estimator_of_our_own_state_that_fails_takes_no_leader_down_seed_1(
    flights: Flights, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It states nothing from 4 to 8 s, then raises."""
    stated = Estimator.own_motion_at

    def failing(self: Estimator, t_ns: int) -> Any:
        motion, begin = stated(self, t_ns), begin_ns.setdefault("t", t_ns)
        if t_ns > begin + 8 * 10**9:
            raise RuntimeError("broken")
        return None if t_ns > begin + 4 * 10**9 else motion

    begin_ns: dict[str, int] = {}
    monkeypatch.setattr(Estimator, "own_motion_at", failing)
    run = flights("mission", "ownship.source=own_state", until=18.0, keep=False)
    assert_followed(run._replace(errors=[]))
    assert run.health.own_motion_sources == {
        f"{quantity}_from_{change}": 1
        for quantity in ("attitude", "velocity")
        for change in ("own_state.own_state_is_surer", "autopilot.own_state_is_not_valid")
    }
    assert run.errors[0].startswith("error in own_state, which cost one message: RuntimeError: broken")
    assert all(isinstance(o, NavState) for o in run.own)

"""No verdict is written by hand: with numbers drawn at random, each claim of each study holds and fails."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from studies.csvsf_quadrotor import claims as csvsf
from studies.cwpa_kalman_tracker_3d import claims as cwpa
from studies.cwpa_kalman_tracker_3d.runs import Scores
from studies.joseph_srukf_sense_and_avoid import claims as joseph
from studies.joseph_srukf_sense_and_avoid.runs import JOSEPH
from studies.own_state import results as own_state
from studies.own_state.flights import DEFAULT, EXPECTED, FlightScore
from studies.relative_motion import claims as relative_motion
from studies.report.findings import Claim
from studies.tracking.outcomes import Outcome, WindowErrors
from studies.ukf_radar_launch_vehicle import claims as launch
from studies.ukf_radar_launch_vehicle.runs import NAMES

Claims = tuple[Claim, ...]
RUNS = 60
WINDOWS = ("settled", "all", "first", "nominal", "jammed", "after", "degraded", "lost", "between")


class Drawn:
    """Numbers about what would be right, off by a factor that scatters little in some draws and much in others."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.scatter = float(rng.choice([0.01, 0.3, 2.0]))

    def about(self, value: float) -> float:
        return value * float(np.exp(self.scatter * self.rng.standard_normal()))

    def some(self) -> int:
        """Runs that fail."""
        return int(self.rng.choice([0, 0, 6, RUNS]))

    def errors(self, n: int) -> WindowErrors:
        position, velocity, acceleration, nees = (self.about(x) for x in (4.0, 4.0, 1.0, n))
        means = [position**2, velocity**2, acceleration**2, nees]
        by_run = np.outer(means, np.exp(0.02 * self.rng.standard_normal(RUNS)))
        inside = float(self.rng.uniform(0.8, 1.0))
        return WindowErrors(position, velocity, acceleration, nees, self.about(3.0), inside, by_run)

    def outcome(self, n: int = 9, names: Sequence[str] = WINDOWS) -> Outcome:
        windows = {name: self.errors(n) for name in names}
        none, condition = np.empty((0, 9)), np.full(50, self.about(200.0))
        return Outcome("drawn", RUNS, self.some(), 1.0, self.some(), windows, none, none, condition)


class Rows(dict[tuple[str, str], Any]):
    """A row of figures for each variant and method that is asked for."""

    def __init__(self, drawn: Drawn) -> None:
        super().__init__()
        self._drawn = drawn

    def __missing__(self, key: tuple[str, str]) -> Any:
        drawn, values = self._drawn, dict[str, float]()

        def value(name: str) -> float:
            right = {"nees": 9.0, "a_long_ft_s2": 0.5, "range_percent": 6.0}.get(name, 1.0)
            return values.setdefault(name, drawn.about(right))

        self[key] = Row(drawn, value, 100.0 * drawn.some() / RUNS)
        return self[key]


@dataclass
class Row:
    """A row; its runs' scores are drawn when a study asks for them."""

    drawn: Drawn
    value: Callable[[str], float]
    diverged_percent: float
    runs: int = RUNS
    nees_bounds: tuple[float, float] = (8.0, 10.0)
    a_lat_converged_s: float = 1.0

    @cached_property
    def scores(self) -> list[Any]:
        return drawn_scores(self.drawn, self.value)


def drawn_scores(drawn: Drawn, value: Callable[[str], float]) -> list[Any]:
    """One score for each run: about the row's figures, by a hundredth."""
    diverged, never = drawn.some(), int(drawn.rng.uniform() < 0.2)
    angles, last = [drawn.about(x) for x in (3.0, 3.0, 2.0)], drawn.about(1.2)
    figures = ("velocity_m_s", "rates_rad_s", "range_percent", "a_long_ft_s2")

    def near(right: float) -> float:
        return right * (1.0 + 0.01 * float(drawn.rng.standard_normal()))

    return [
        SimpleNamespace(
            seed=k,
            diverged="x" if k < diverged else None,
            a_lat_converged_s=None if k < never else 1.0,
            size_error_first_percent=near(2.0),
            size_error_last_percent=near(last),
            angle_error_deg=tuple(near(x) for x in angles),
            **{name: near(value(name)) for name in figures},
        )
        for k in range(RUNS)
    ]


def of_cwpa(drawn: Drawn) -> Claims:
    def scores(nees: float) -> Scores:
        errors = (drawn.about(x) for x in (1.0, 1.0, 1.0, 1.5, 1.0))
        return Scores._make((*errors, nees, 0.95, 0.01, 0.1))

    signs = drawn.rng.choice([1.0, 1.0, -1.0], 3).tolist()
    drawn_, rest, printed = (scores(sign * drawn.about(9.0)) for sign in signs)
    return cwpa.claims_of(drawn_, rest, printed)


def of_launch(drawn: Drawn) -> Claims:
    names = ("ukf", "ekf", "ukf-scaled", "ekf-plain")

    def results() -> Any:
        within = {name: float(np.clip(drawn.about(0.7), 0.0, 1.0)) for name in names}
        return SimpleNamespace(outcomes={name: drawn.outcome(9, NAMES) for name in names}, within=within, gap=0.0)

    return launch.claims_of(results(), results(), [results()], dict.fromkeys(NAMES, 50.0))


def of_joseph(drawn: Drawn) -> Claims:
    trackers = (
        *("ekf", "ukf", "srukf", "iplf", "ekf-plain", "srukf-textbook", "srukf-classical", JOSEPH),
        *("negative-classical", "negative-joseph"),
    )

    def results(n: int) -> Any:
        outcomes = {name: drawn.outcome(n) for name in trackers}
        if drawn.rng.uniform() < 0.5:
            outcomes["ukf"] = outcomes["ukf"]._replace(condition=outcomes["srukf"].condition ** 2)
        raw = {name: drawn.about(10.0) for name in WINDOWS}
        return SimpleNamespace(outcomes=outcomes, raw=raw, gap=0.0)

    scenes = ("validation", "radar", "uncorrected", "rain", "sharp_single", "sharp_double", "acquisition")
    durations = {name: drawn.about(1.0) for name in trackers}
    every = {name: results(9) for name in scenes} | {"gnss": results(11), "durations": durations}
    return joseph.claims_of(cast("Any", SimpleNamespace(**every)))


def of_own_state(drawn: Drawn) -> Claims:
    good, alarms = drawn.rng.uniform() < 0.5, float(drawn.rng.choice([0.0, 0.3]))

    def flight(name: str) -> FlightScore:
        named = good if name in own_state.HEAVIER or drawn.rng.uniform() < 0.9 else bool(drawn.rng.uniform() < 0.5)
        named = named and not (good and name in own_state.WEAKER and drawn.scatter < 1.0)
        wrong = ("gust",) * int(drawn.rng.uniform() < alarms)
        return FlightScore(0.1, 0.01, 0.2, 100.0, named, 0.3, 0.1, wrong, 60.0, 0)

    return own_state.claims_of({(name, DEFAULT): [flight(name) for _ in range(40)] for name in EXPECTED})


@pytest.mark.parametrize(
    "claims_of",
    [
        *(of_cwpa, of_launch, of_joseph, of_own_state),
        lambda drawn: csvsf.claims_of(Rows(drawn)),
        lambda drawn: relative_motion.claims_of(Rows(drawn)),
    ],
    ids=["cwpa", "launch", "joseph", "own-state", "csvsf", "relative-motion"],
)
def test_every_verdict_changes_with_the_numbers_seed_1(
    claims_of: Callable[[Drawn], Claims], monkeypatch: pytest.MonkeyPatch
) -> None:
    rng, seen = np.random.default_rng(1), dict[str, set[str]]()
    for k in range(1500):
        # the terms of two series are numbers, too
        terms: Sequence[float] = rng.permutation([1 / 6, 1 / 4, 1 / 5]).tolist()
        monkeypatch.setattr(cwpa, "third_terms", lambda terms=terms: terms)
        for claim in claims_of(Drawn(rng)):
            seen.setdefault(claim.claim, set()).add(claim.verdict)
        if k > 20 and all({"holds", "does not hold"} <= verdicts for verdicts in seen.values()):
            break
    assert [claim for claim, verdicts in seen.items() if not {"holds", "does not hold"} <= verdicts] == []


def test_the_third_terms_are_those_of_the_series() -> None:
    third, taylor, pade = cwpa.third_terms()
    assert third == pytest.approx(taylor, rel=0.01)
    assert pade == pytest.approx(1 / 4, rel=0.02)

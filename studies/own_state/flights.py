"""The flights of the study of our own state, and their scores.

simlink's quadrotor flies through the daemon's pipeline.
"""

from collections.abc import Iterable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from onboard.config import parse_config
from onboard.messages import Datagram, FaultKind, Message, NavState, Truth
from onboard.pipeline import Pipeline
from onboard.scoring.statistics import availability
from simlink.scenarios.scenario import Scenario, load_scenario
from simlink.simulation import datagrams, simulate

FAULT_TIME_S: Final = 10.0  # in the scenarios
DURATION_S: Final = 12.5  # of flights for the naming of faults
LONG_DURATIONS_S: Final = {"quadrotor": 20.0, "quadrotor-weak-inputs": 18.0, "quadrotor-gust": 18.0}
PUBLISH_RATE_HZ: Final = 25.0  # as often as there is truth
MAX_NAMING_DELAY_S: Final = 1.0
FILTERS: Final = ("cubature", "csvsf", "csvsf-robust", "csvsf-adaptive")
DEFAULT: Final = FILTERS[-1]
WITH_VERTICAL: Final = ", fixes with vertical velocity"
NO_BAROMETER: Final = ", no barometer"
EXPECTED: Final[dict[str, tuple[FaultKind, str | None] | None]] = {
    "quadrotor": None,
    "quadrotor-inertia-half": None,
    "quadrotor-inertia-more": None,
    "quadrotor-motor": (FaultKind.MOTOR, "motor 1"),
    "quadrotor-weak-inputs": (FaultKind.MASS, None),
    "quadrotor-heavier": (FaultKind.MASS, None),
    "quadrotor-much-heavier": (FaultKind.MASS, None),
    "quadrotor-gust": (FaultKind.GUST, None),
    "quadrotor-outliers": (FaultKind.OUTLIERS, None),
}


class FlightScore(NamedTuple):
    """The score of one flight after the fault's time."""

    velocity: float  # m/s, RMS error of the valid states
    attitude: float  # rad, RMS error of the valid states
    worst: float  # m/s, the largest velocity error
    valid_percent: float  # of the time
    named: bool  # whether the fault was named rightly in time
    delay: float  # s, of the naming, NaN without
    onset: float  # s, error of the named onset, NaN without
    wrong: tuple[str, ...]  # names
    watched: float  # s, for wrong names
    resets: int


def section(method: str) -> dict[str, Any]:
    """The estimator's section: the nominal craft, and nothing of the noise of its messages.

    `method` is a filter's name, with NO_BAROMETER appended or not.
    """
    without = {"pressure_rate_hz": 0.0} if method.endswith(NO_BAROMETER) else {}
    return {
        **without,
        "filter": method.removesuffix(NO_BAROMETER),
        "airframe": "csvsf",
        "publish_rate_hz": PUBLISH_RATE_HZ,
    }


def fly(
    scenario: Scenario, seed: int, seconds: float, methods: Sequence[str], vertical: bool = False
) -> tuple[list[list[NavState]], list[Truth]]:
    """Return the states of one flight by each of the methods, and its truth.

    Bytes go through the pipelines; with `vertical` records, which hold the fixes' vertical velocity.
    """
    delay = {"gps_s": scenario.gps.delay}
    configs = [{"estimator": {"own_state": section(method)}, "delay": delay} for method in methods]
    pipelines = [Pipeline(parse_config(config)) for config in configs]
    states: list[list[NavState]] = [[] for _ in methods]
    truths: list[Truth] = []
    records = (e.message for e in simulate(scenario, seed, seconds, camera="none"))
    items: Iterable[Any] = records if vertical else datagrams(scenario, seed, seconds, camera="none")
    for item in items:
        if isinstance(item, Truth):
            truths.append(item)
            continue
        for pipeline, known in zip(pipelines, states, strict=True):
            if isinstance(item, Datagram):
                known += [o for o in pipeline.feed(item) if isinstance(o, NavState)]
            elif isinstance(item, Message):
                known += [o for o in pipeline.advance([item]) if isinstance(o, NavState)]
    return states, truths


def judge(
    states: Sequence[NavState], truths: Sequence[Truth], expected: tuple[FaultKind, str | None] | None
) -> FlightScore:
    """Compare a flight with its truth.

    A fault that is not the expected one, or named before it came, is wrong.
    """
    start = truths[0].t_ns
    begin = start + round(FAULT_TIME_S * 1e9)
    at = {s.t_ns: s for s in states if s.valid and s.mean is not None}
    pairs = [(t, at[t.t_ns]) for t in truths if t.t_ns in at and t.t_ns > begin]
    samples = np.array([t.t_ns * 1e-9 for t in truths if t.t_ns > begin])
    available = availability(samples, [s.t_ns * 1e-9 for s in states], [s.valid for s in states])
    velocity = np.array([np.subtract(t.v_F_n, (s.mean or ())[3:6]) for t, s in pairs])
    cosine = np.array([abs(np.dot(t.q_nF, s.q_nb or ())) for t, s in pairs])
    first: dict[tuple[str, str, int], int] = {}  # time at which each fault was first named
    for s in states:
        for f in s.faults:
            first.setdefault((f.kind, f.part, f.t_onset_ns), s.t_ns)
    right = {
        key: t
        for key, t in first.items()
        if expected is not None and key[0] == expected[0] and expected[1] in (None, key[1]) and t >= begin
    }
    delay = (min(right.values()) - begin) * 1e-9 if right else float("nan")
    onset = min(((key[2] - begin) * 1e-9 for key in right), key=abs, default=float("nan"))
    return FlightScore(
        velocity=float(np.sqrt((velocity**2).sum(axis=1).mean())),
        attitude=float(np.sqrt(np.mean((2 * np.arccos(np.clip(cosine, -1.0, 1.0))) ** 2))),
        worst=float(np.sqrt((velocity**2).sum(axis=1).max())),
        valid_percent=100.0 * float(np.mean(available)),
        named=delay <= MAX_NAMING_DELAY_S,
        delay=delay,
        onset=onset,
        wrong=tuple(f"{kind} {part}".strip() for (kind, part, _) in first.keys() - right.keys()),
        watched=(truths[-1].t_ns - start) * 1e-9,
        resets=states[-1].reset_count,
    )


def fly_and_judge(name: str, seeds: Sequence[int], methods: Sequence[str]) -> list[list[FlightScore]]:
    """Score all seeds of a scenario by each of the methods.

    They are filters' names, optionally with NO_BAROMETER appended, or all with WITH_VERTICAL.
    """
    scenario, seconds = load_scenario(name), LONG_DURATIONS_S.get(name, DURATION_S)
    vertical = all(method.endswith(WITH_VERTICAL) for method in methods)
    filters = [method.removesuffix(WITH_VERTICAL) for method in methods]
    flights = [fly(scenario, seed, seconds, filters, vertical) for seed in seeds]
    return [[judge(states[k], truths, EXPECTED[name]) for states, truths in flights] for k in range(len(methods))]

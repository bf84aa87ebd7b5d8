"""The estimator of our own state, as flown: simlink's quadrotor over MAVLink, with faults, through the daemon's
own pipeline. No paper: what is judged is our product. GPS at 10 Hz and 0.1 s late, heights without vertical
velocity (as MAVLink has it), attitude and rates at 100 Hz, accelerometer at 100 Hz, barometer and motor outputs at
50 Hz.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from onboard.config import parse_config
from onboard.messages import Datagram, FaultKind, Message, NavState, Truth
from onboard.pipeline import Pipeline
from onboard.studies.report import findings as report
from onboard.studies.report.findings import Check, Claim, Findings, Table
from onboard.studies.report.workers import Part, Progress, compute, require_seeds, write
from simlink.scenarios.scenario import Scenario, load_scenario
from simlink.simulation import datagrams, simulate

NAME: Final = "own-state"
TITLE: Final = "Our own state from MAVLink: accuracy under faults, and faults named"
FAULT_AT: Final = 10.0  # s, in the scenarios
SECONDS: Final = 12.5  # of flights that are for the naming
LONG_SECONDS: Final[dict[str, float]] = {
    "quadrotor": 20.0,
    "quadrotor-weak-inputs": 18.0,
    "quadrotor-gust": 18.0,
}
PUBLISHED_HZ: Final = 25.0  # as often as there is truth
NAMED_WITHIN: Final = 1.0  # s
FILTERS: Final = ("cubature", "csvsf", "csvsf-robust", "csvsf-adaptive")
WITH_VERTICAL: Final = ", fixes with vertical velocity"
NO_BAROMETER: Final = ", no barometer"
COMPARED: Final = ("quadrotor-weak-inputs", "quadrotor-gust", "quadrotor-outliers")
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


class Flown(NamedTuple):
    """One flight's judgement: RMS velocity and attitude errors after the fault's time (m/s, rad), the largest
    velocity error, whether it was named rightly in time, delay (s) and onset error (s) of that, wrong names and
    the seconds that were watched for them, and resets."""

    velocity: float
    attitude: float
    worst: float
    named: bool
    delay: float
    onset: float
    wrong: tuple[str, ...]
    watched: float
    resets: int


def section(used: str) -> dict[str, Any]:
    """The estimator's section: the nominal craft, and the noise its autopilot's messages have. `used` is a
    filter's name, with NO_BAROMETER behind it or not."""
    without = {"pressure_rate_hz": 0.0} if used.endswith(NO_BAROMETER) else {}
    return {
        **without,
        "filter": used.removesuffix(NO_BAROMETER),
        "airframe": "csvsf",
        "gps_position_sigma_m": [0.5, 0.5, 1.0],
        "bias_sigma_m_s2": 0.02,
        "own_tilt_sigma_deg": 0.0,
        "own_yaw_sigma_deg": 0.0,
        "publish_rate_hz": PUBLISHED_HZ,
    }


def fly(
    scenario: Scenario, seed: int, seconds: float, used: Sequence[str], vertical: bool = False
) -> tuple[list[list[NavState]], list[Truth]]:
    """One flight's states by each of the filters `used`, and its truth, through bytes and pipelines; with
    `vertical` as records, which hold the fixes' vertical velocity."""
    delay = {"gps_s": scenario.gps.delay}
    configs = [{"estimator": {"own_state": section(each)}, "delay": delay} for each in used]
    pipelines = [Pipeline(parse_config(config)) for config in configs]
    states: list[list[NavState]] = [[] for _ in used]
    truths: list[Truth] = []
    items = (e.message for e in simulate(scenario, seed, seconds, camera="none"))
    for item in items if vertical else datagrams(scenario, seed, seconds, camera="none"):
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
) -> Flown:
    """A flight held against its truth. A fault named that is not the expected one, or named before it came, is
    wrong."""
    start = truths[0].t_ns
    begin = start + round(FAULT_AT * 1e9)
    at = {s.t_ns: s for s in states if s.mean is not None}
    pairs = [(t, at[t.t_ns]) for t in truths if t.t_ns in at and t.t_ns > begin]
    velocity = np.array([np.subtract(t.v_F_n, (s.mean or ())[3:6]) for t, s in pairs])
    cosine = np.array([abs(np.dot(t.q_nF, s.q_nb or ())) for t, s in pairs])
    first: dict[tuple[str, str, int], int] = {}
    for s in states:
        for f in s.faults:
            first.setdefault((f.kind, f.part, f.t_onset_ns), s.t_ns)
    right = {
        key: t
        for key, t in first.items()
        if expected is not None and key[0] == expected[0] and expected[1] in (None, key[1]) and t >= begin
    }
    told = min(right.values(), default=None)
    onset = min(((key[2] - begin) * 1e-9 for key in right), key=abs, default=float("nan"))
    return Flown(
        velocity=float(np.sqrt((velocity**2).sum(axis=1).mean())),
        attitude=float(np.sqrt(np.mean((2 * np.arccos(np.clip(cosine, -1.0, 1.0))) ** 2))),
        worst=float(np.sqrt((velocity**2).sum(axis=1).max())),
        named=told is not None and told - begin <= NAMED_WITHIN * 1e9,
        delay=float("nan") if told is None else (told - begin) * 1e-9,
        onset=onset,
        wrong=tuple(f"{kind} {part}".strip() for (kind, part, _) in first.keys() - right.keys()),
        watched=(truths[-1].t_ns - start) * 1e-9,
        resets=states[-1].reset_count,
    )


def fly_and_judge(name: str, seeds: Sequence[int], seconds: float, used: Sequence[str]) -> list[list[Flown]]:
    """All seeds of a scenario, by each of the filters `used`: their names, with NO_BAROMETER behind them or not,
    or all with WITH_VERTICAL."""
    scenario = load_scenario(name)
    vertical = all(each.endswith(WITH_VERTICAL) for each in used)
    methods = [each.removesuffix(WITH_VERTICAL) for each in used]
    flights = [fly(scenario, seed, seconds, methods, vertical) for seed in seeds]
    return [[judge(states[k], truths, EXPECTED[name]) for states, truths in flights] for k in range(len(used))]


def run(
    seeds: int = 2,
    first_seed: int = 101,
    jobs: int | None = None,
    out: Path | None = None,
    progress: Progress | None = None,
) -> Findings:
    """The study. Thresholds were chosen on seeds 1 to 20. Sixty seeds take a quarter of an hour on two cores."""
    every = require_seeds(seeds, first_seed)
    default = FILTERS[-1]
    keys = [(name, default) for name in EXPECTED]
    keys += [(name, default + how) for name in COMPARED[:2] for how in (WITH_VERTICAL, NO_BAROMETER)]
    keys += [(name, other) for name in COMPARED for other in FILTERS[:-1]]
    work = list(_work(keys, every, default))
    parts = [
        Part(fly_and_judge, (name, chunk, LONG_SECONDS.get(name, SECONDS), used)) for name, used, chunk in work
    ]
    flown: dict[tuple[str, str], list[Flown]] = {key: [] for key in keys}
    for (name, used, _), found_of_each in zip(work, compute(parts, jobs, progress), strict=True):
        for each, flights in zip(used, found_of_each, strict=True):
            flown[name, each] += flights
    found = Findings(
        study=NAME,
        title=TITLE,
        setting=__doc__.split("\n\n")[0].replace("\n", " ") if __doc__ else "",
        seeds=seeds,
        first_seed=first_seed,
        tables=(_accuracy(flown), _naming({name: flown[name, default] for name in EXPECTED})),
        checks=_checks(flown, default),
        claims=_claims({name: flown[name, default] for name in EXPECTED}),
        misprints=(),
        figures=(),
    )
    if out is not None:
        write(found, out)
    return found


def _work(
    keys: Sequence[tuple[str, str]], every: range, default: str
) -> Iterator[tuple[str, tuple[str, ...], range]]:
    """Scenario, filters and seeds of each part. Filters that hear the same fly together; what is not the default
    flies a quarter of the seeds."""
    few = -(-len(every) // 4)
    for name in EXPECTED:
        used = [each for scenario, each in keys if scenario == name]
        of_records = tuple(each for each in used if each.endswith(WITH_VERTICAL))
        of_bytes = tuple(each for each in used if each not in of_records)
        for together, seeds in ((of_bytes, every[:few]), ((default,), every[few:]), (of_records, every[:few])):
            if together:
                yield from ((name, together, chunk) for chunk in _chunks(seeds))


def _chunks(seeds: range) -> list[range]:
    """Seeds in lots of ten, so that the progress moves."""
    return [seeds[i : i + 10] for i in range(0, len(seeds), 10)]


def _pooled(flights: Sequence[Flown]) -> tuple[float, float, float]:
    """Velocity and attitude RMS over all flights, and the worst velocity error."""
    velocity = float(np.sqrt(np.mean([f.velocity**2 for f in flights])))
    attitude = float(np.sqrt(np.mean([f.attitude**2 for f in flights])))
    return velocity, attitude, max(f.worst for f in flights)


def _accuracy(flown: dict[tuple[str, str], list[Flown]]) -> Table:
    return Table(
        title="Accuracy after the fault",
        note=f"From {FAULT_AT:g} s to the flight's end at {SECONDS:g} s (all inputs x .7 and gust 18 s, nothing "
        "wrong 20 s), norms of vectors; the raw fixes' velocity noise is 0.15 m/s per axis. "
        "What is not the default: a quarter of the seeds.",
        header=("scenario", "filter", "velocity m/s", "worst m/s", "attitude rad", "resets"),
        rows=tuple(
            (name, used, velocity, worst, attitude, float(sum(f.resets for f in flights)))
            for (name, used), flights in flown.items()
            for velocity, attitude, worst in [_pooled(flights)]
        ),
    )


def _naming(flown: dict[str, list[Flown]]) -> Table:
    return Table(
        title="Faults named",
        note="Right: kind (and motor) within 1 s. Wrong: any other name, at any time of the flight.",
        header=("scenario", "right %", "delay s, median", "delay s, largest", "onset off by s, RMS", "wrong"),
        rows=tuple(
            (
                name,
                100 * float(np.mean([f.named for f in flights])) if EXPECTED[name] is not None else None,
                _of(np.median, [f.delay for f in flights]),
                _of(np.max, [f.delay for f in flights]),
                _of(lambda x: np.sqrt(np.mean(np.square(x))), [f.onset for f in flights]),
                ", ".join(sorted(w for f in flights for w in f.wrong)) or "none",
            )
            for name, flights in flown.items()
        ),
    )


def _of(statistic: Any, values: Sequence[float]) -> float | None:
    known = [v for v in values if np.isfinite(v)]
    return float(statistic(known)) if known else None


def _checks(flown: dict[tuple[str, str], list[Flown]], used: str) -> tuple[Check, ...]:
    named = [
        report.check(
            f"{name.removeprefix('quadrotor-')} named within 1 s",
            "%",
            100 * float(np.mean([f.named for f in flown[name, used]])),
            95.0,
        )
        for name, expected in EXPECTED.items()
        if expected is not None
    ]
    watched = sum(f.watched for name in EXPECTED for f in flown[name, used]) / 3600
    wrong = sum(len(f.wrong) for name in EXPECTED for f in flown[name, used])
    return (
        *(
            report.check(f"velocity, {what}", "m/s", _pooled(flown[name, used])[0], None, limit)
            for what, name, limit in (
                ("all inputs x .7", "quadrotor-weak-inputs", 0.07),
                ("gust of 3 m/s² for 2 s", "quadrotor-gust", 0.3),
            )
        ),
        *named,
        report.check("false alarms per simulated hour", "1/h", wrong / watched, None, 1.0),
    )


def _claims(flown: dict[str, list[Flown]]) -> tuple[Claim, ...]:
    watched = sum(f.watched for flights in flown.values() for f in flights) / 3600
    wrong = sum(len(f.wrong) for flights in flown.values() for f in flights)
    judged = [f.named for name, flights in flown.items() if EXPECTED[name] is not None for f in flights]
    share = float(np.mean(judged))
    return (
        Claim(
            claim="Motor loss, mass change, gust and outliers are told apart within 1 s.",
            where="our own",
            verdict="holds" if share >= 0.95 else "does not hold",
            evidence=f"{100 * share:.1f} % of {len(judged)} flights.",
        ),
        Claim(
            claim="Fewer than one false alarm in an hour.",
            where="our own",
            verdict="holds" if wrong / watched < 1.0 else "does not hold",
            evidence=f"{wrong} in {watched:.2f} simulated hours.",
        ),
        Claim(
            claim="Another mass is told from weaker motors.",
            where="our own",
            verdict="does not hold",
            evidence="In hover both lift less for the same commands and give no torque: both are named mass.",
        ),
    )

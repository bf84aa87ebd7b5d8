"""Tables, checks and claims of the study of our own state."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from studies.own_state.flights import DEFAULT, DURATION_S, EXPECTED, FAULT_TIME_S, FlightScore
from studies.report.findings import Check, Claim, Table, check, verdict
from studies.report.sampling import all_of, at_least, at_most, rarer

HEAVIER: Final = ("quadrotor-heavier", "quadrotor-much-heavier")  # `EXPECTED` of both is mass ...
WEAKER: Final = ("quadrotor-weak-inputs",)  # ... and of this, too: nothing else fits what is seen
Flights = Mapping[tuple[str, str], Sequence[FlightScore]]  # by scenario and method


def accuracy_table(flights: Flights) -> Table:
    """Errors of each method in each scenario."""
    return Table(
        title="Accuracy after the fault",
        note=f"From {FAULT_TIME_S:g} s to the flight's end at {DURATION_S:g} s (all inputs x .7 and gust 18 s, "
        "nothing wrong 20 s), norms of vectors; the raw fixes' velocity noise is 0.15 m/s per axis. Methods "
        "other than the default: a quarter of the seeds.",
        header=("scenario", "filter", "velocity m/s", "worst m/s", "attitude rad", "resets", "valid %"),
        rows=tuple(
            (
                name,
                method,
                _rms([f.velocity for f in each]),
                max(f.worst for f in each),
                _rms([f.attitude for f in each]),
                float(sum(f.resets for f in each)),
                float(np.mean([f.valid_percent for f in each])),
            )
            for (name, method), each in flights.items()
        ),
    )


def naming_table(flights: Flights) -> Table:
    """Faults named by the default method."""
    return Table(
        title="Faults named",
        note="Right: kind (and motor) within 1 s. Wrong: any other name, at any time of the flight.",
        header=("scenario", "right %", "delay s, median", "delay s, largest", "onset off by s, RMS", "wrong"),
        rows=tuple(
            (
                name,
                100 * float(np.mean([f.named for f in each])) if expected is not None else None,
                _over(np.median, [f.delay for f in each]),
                _over(np.max, [f.delay for f in each]),
                _over(_rms, [f.onset for f in each]),
                ", ".join(sorted(w for f in each for w in f.wrong)) or "none",
            )
            for name, expected in EXPECTED.items()
            for each in (flights[name, DEFAULT],)
        ),
    )


def checks_of(flights: Flights) -> tuple[Check, ...]:
    """Our own requirements, of the default method."""
    limits = {
        "velocity, all inputs x .7": ("quadrotor-weak-inputs", 0.07),
        "velocity, gust of 3 m/s² for 2 s": ("quadrotor-gust", 0.3),
    }
    wrong, hours = _false_alarms(flights)
    return (
        *(
            check(what, "m/s", _rms([f.velocity for f in flights[name, DEFAULT]]), None, limit)
            for what, (name, limit) in limits.items()
        ),
        *(
            check(
                f"{name.removeprefix('quadrotor-')} named within 1 s",
                "%",
                100 * float(np.mean([f.named for f in flights[name, DEFAULT]])),
                95.0,
            )
            for name, expected in EXPECTED.items()
            if expected is not None
        ),
        check("false alarms per simulated hour", "1/h", wrong / hours, None, 1.0),
    )


def claims_of(flights: Flights) -> tuple[Claim, ...]:
    """Judge our own claims, of the default method."""
    wrong, hours = _false_alarms(flights)
    named = [f.named for name in EXPECTED if EXPECTED[name] is not None for f in flights[name, DEFAULT]]
    share = float(np.mean(named))
    weak, heavy = (_named(flights, names) for names in (WEAKER, HEAVIER))
    return (
        Claim(
            claim="Motor loss, mass change, gust and outliers are distinguished within 1 s.",
            where="our own",
            verdict=verdict(at_least(sum(named), len(named), 0.95)),
            evidence=f"{100 * share:.1f} % of {len(named)} flights.",
        ),
        Claim(
            claim="Fewer than one false alarm in an hour.",
            where="our own",
            verdict=verdict(rarer(wrong, hours, 1.0)),
            evidence=f"{wrong} in {hours:.2f} simulated hours.",
        ),
        Claim(
            claim="Another mass is distinguished from weaker motors.",
            where="our own",
            verdict=verdict(all_of([at_least(sum(heavy), len(heavy), 0.95), at_most(sum(weak), len(weak), 0.05)])),
            evidence=f"Named mass: {100 * np.mean(heavy):.0f} % of flights with another mass, "
            f"{100 * np.mean(weak):.0f} % of those with motors that are all weaker. "
            "In hover both lift less for the same commands and give no torque.",
        ),
    )


def _named(flights: Flights, names: Sequence[str]) -> list[bool]:
    """Return whether the default method named the fault of each flight as mass in time."""
    return [f.named for name in names for f in flights[name, DEFAULT]]


def _false_alarms(flights: Flights) -> tuple[int, float]:
    """Wrong names by the default method, and the simulated hours watched."""
    each = [f for name in EXPECTED for f in flights[name, DEFAULT]]
    return sum(len(f.wrong) for f in each), sum(f.watched for f in each) / 3600


def _rms(values: ArrayLike) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _over(statistic: Callable[[list[float]], Any], values: Sequence[float]) -> float | None:
    """A statistic of the finite values; None without any."""
    known = [v for v in values if np.isfinite(v)]
    return float(statistic(known)) if known else None

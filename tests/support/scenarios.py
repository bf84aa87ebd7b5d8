"""simlink's scenarios flown in this process, each simulated once for all settings."""

import math
from pathlib import Path
from typing import Final, NamedTuple

from onboard.config import load_config
from onboard.messages import Datagram, Encoding, Estimate, Health, NavState, Truth
from onboard.pipeline import Pipeline
from onboard.scoring.beside import PRIMARY_ESTIMATOR, LeaderScorers
from onboard.scoring.leader import LeaderScore
from onboard.scoring.reference import reference_from_records
from simlink.scenarios.describe import daemon_config
from simlink.scenarios.scenario import load_scenario
from simlink.simulation import boot_time_ns
from tests.support import kept

SECONDS: Final = {  # of flight, where it matters
    "formation-drop-out": 38.0,  # without images from 30 to 35 s
    "formation-out-of-view": 48.0,  # in view again after 42 s
    "formation-hover": 60.0,
    "formation-speed-change": 60.0,
    "mission": 32.0,  # a motor weakens at 30 s
}
SHORT_DURATION_S: Final = 25.0  # of the others; they are scored from 15 s on


class Recorded(NamedTuple):
    """A simulated flight: its datagrams without radar scans, which no .tlog holds, and the truth."""

    datagrams: list[Datagram]
    truths: list[Truth]


class Replayed(NamedTuple):
    """The outputs and scores of a replayed flight."""

    estimates: list[Estimate]  # of the leader
    score: LeaderScore
    boot_ns: int  # boot time at the beginning of the flight
    own: list[NavState]
    health: Health  # at the end
    errors: list[str]  # exceptions until the end
    beside: dict[str, LeaderScore]  # of other estimators of the leader, by name

    def at(self, begin: float, end: float) -> list[Estimate]:
        """Estimates between two times of flight, s."""
        return [e for e in self.estimates if begin <= (e.t_ns - self.boot_ns) * 1e-9 < end]


def seconds(scenario: str) -> float:
    """Return the duration of a scenario in these tests."""
    return SECONDS.get(scenario, SHORT_DURATION_S)


class Flights:
    """Replays of one seed.

    Each flight is simulated once, and each replay made once. `folder` is for their configurations.
    """

    def __init__(self, folder: Path, seed: int) -> None:
        self.seed = seed
        self._folder = folder
        self._recorded: dict[tuple[str, float], Recorded] = {}
        self._replayed: dict[tuple[float, tuple[str, ...]], Replayed] = {}

    def __call__(self, scenario: str, *settings: str, until: float | None = None, keep: bool = True) -> Replayed:
        """Return the scenario with its own configuration and these settings.

        It lasts `until` s, or `seconds`. `keep` stores it on disk, for flights without patches.
        """
        end = seconds(scenario) if until is None else until
        key = (end, (scenario, *settings))
        if key not in self._replayed:
            self._replayed[key] = self._replay(scenario, settings, end, keep=keep)
        return self._replayed[key]

    def _replay(self, scenario: str, settings: tuple[str, ...], end: float, *, keep: bool) -> Replayed:
        loaded = load_scenario(scenario)
        path = self._folder / f"{scenario}.toml"
        path.write_text(daemon_config(loaded), encoding="utf-8")
        config, flight = load_config(path, settings), self._flight(scenario, end)

        def fly() -> tuple[list[Estimate], Health, list[str]]:
            pipeline = Pipeline(config)
            made = [o for d in flight.datagrams for o in pipeline.feed(d) if isinstance(o, Estimate)]
            return made, pipeline.health(flight.datagrams[-1].t_recv_ns), pipeline.errors

        made, health, errors = kept.flown((flight.datagrams, config), fly) if keep else fly()
        made = [o for o in made if o.is_primary]
        own = [o for o in made if isinstance(o, NavState)]
        estimates = [o for o in made if not isinstance(o, NavState)]
        scorers = LeaderScorers(reference_from_records(flight.truths))
        for estimate in estimates:
            scorers.add(estimate)
        score, beside = scorers.scores(math.inf)
        of_leader = [e for e in estimates if e.name == PRIMARY_ESTIMATOR]
        return Replayed(of_leader, score, boot_time_ns(loaded), own, health, errors, beside)

    def _flight(self, scenario: str, end: float) -> Recorded:
        key = (scenario, end)
        if key not in self._recorded:
            loaded = load_scenario(scenario)
            items = kept.flight(loaded, self.seed, end, camera="mavlink")
            arriving = [i for i in items if isinstance(i, Datagram) and i.encoding is not Encoding.RADAR]
            self._recorded[key] = Recorded(arriving, [i for i in items if isinstance(i, Truth)])
        return self._recorded[key]

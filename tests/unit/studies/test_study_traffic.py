"""The study of traffic: one short flight, and its verdicts on flights made up by hand."""

import json
from pathlib import Path

import pytest

from simlink.scenarios.scenario import load_scenario
from studies.report.files import write
from studies.traffic import study as traffic
from studies.traffic.scores import AircraftScore, Encounter, TrafficScore


def scored(name: str, **changes: object) -> AircraftScore:
    plain = AircraftScore(name, ("icao/1",), 1000, 950, 0.0, 2.0, (Encounter(60.0, 100.0, 108.0),), 100.0)
    return plain._replace(**changes)


def verdicts(*flown: TrafficScore) -> list[str]:
    return [str(claim.verdict) for claim in traffic.findings(flown, 1).claims]


def of_one(**changes: object) -> TrafficScore:
    """Two aircraft, the first of them changed."""
    return TrafficScore((scored("one", **changes), scored("glider")), (), {})


def test_good_flights_meet_every_requirement() -> None:
    assert verdicts(of_one(), of_one()) == ["holds"] * 4


@pytest.mark.parametrize(
    ("bad", "which"),
    [
        (of_one()._replace(swaps=("icao/1",)), 0),
        (of_one(missing_s=3.0), 1),
        (of_one(encounters=(Encounter(60.0, 100.0, 120.0),)), 2),
        (of_one(encounters=(Encounter(60.0, 100.0, float("nan")),)), 2),
        (of_one(encounters=(Encounter(60.0, 100.0, float("nan")), Encounter(70.0, 100.0, 100.0))), 2),
        (TrafficScore((scored("one", inside=900), scored("glider", inside=1000)), (), {}), 3),
    ],
)
def test_a_bad_flight_fails_its_requirement(bad: TrafficScore, which: int) -> None:
    found = verdicts(bad)
    assert [k for k, verdict in enumerate(found) if verdict == "does not hold"] == [which]


def test_approaches_that_nobody_could_know_count_against_what_was_asked() -> None:
    """It holds only of those that could be known."""
    unknown = tuple(Encounter(60.0 + k, 100.0, float("nan"), known=False) for k in range(2))
    found = traffic.findings([of_one(encounters=(*unknown, Encounter(90.0, 100.0, 101.0)))], 1)
    assert found.claims[2].verdict == "holds only if"
    assert "50.0 % of all 4" in found.claims[2].evidence


def test_an_aircraft_that_turns_counts_against_what_was_asked() -> None:
    changing = scored("s-turn", encounters=tuple(Encounter(60.0 + k, 100.0, 200.0) for k in range(3)))
    names = [a.name for a in load_scenario("traffic").traffic.aircraft if a.a_lat.amplitude]
    flown = TrafficScore((scored("one"), changing._replace(name=names[0])), (), {})
    assert traffic.findings([flown], 1).claims[2].verdict == "holds only if"


def test_a_flight_is_scored_and_written_seed_101(tmp_path: Path) -> None:
    found = traffic.findings([traffic.fly(101, "ekf", 12.0)], 101)
    write(found, tmp_path)
    assert json.loads((tmp_path / "result.json").read_bytes())["study"] == "traffic"
    assert len(found.tables[0].rows) == 20
    assert found.claims[0].verdict == "holds"
    assert {c.unit for c in found.checks} == {"", "s", "%"}

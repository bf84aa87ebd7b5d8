"""The study of traffic: one short flight, and its verdicts on flights made up by hand."""

import pytest

from onboard.scoring.traffic import AircraftScore, Encounter, TrafficScore
from onboard.studies.traffic import study as traffic


def scored(name: str, **changes: object) -> AircraftScore:
    plain = AircraftScore(name, ("icao/1",), 1000, 950, 0.0, 2.0, (Encounter(60.0, 100.0, 108.0),))
    return plain._replace(**changes)  # type: ignore[arg-type]  # its own fields


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
        (TrafficScore((scored("one", inside=900), scored("glider", inside=1000)), (), {}), 3),
    ],
)
def test_a_bad_flight_fails_its_requirement(bad: TrafficScore, which: int) -> None:
    found = verdicts(bad)
    assert [k for k, verdict in enumerate(found) if verdict == "does not hold"] == [which]


def test_a_flight_is_scored_seed_101() -> None:
    found = traffic.findings([traffic.fly(101, "ekf", 12.0)], 101)
    assert len(found.tables[0].rows) == 20
    assert found.claims[0].verdict == "holds"
    assert {c.unit for c in found.checks} == {"", "s", "%"}


@pytest.mark.slow
def test_attitude_errors_of_radar_only_aircraft_are_known_by_the_reports_of_others_seed_102() -> None:
    """Half a degree of our own attitude is 15 m at their distance."""
    score = traffic.fly(102, "imm", 30.0)
    silent = [a for a in score.aircraft if a.name.startswith("crossing-") and a.samples > 100]
    assert len(silent) >= 3
    assert max(a.rmse for a in silent) < 8.0

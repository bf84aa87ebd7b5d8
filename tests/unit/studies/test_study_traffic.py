"""The study of traffic: one short flight, and what it says of flights made up by hand."""

import pytest

from onboard.scoring.traffic import Encounter, Score, Scored
from onboard.studies.traffic import study as traffic


def scored(name: str, **changes: object) -> Scored:
    plain = Scored(name, ("icao/1",), 1000, 950, 0.0, 2.0, (Encounter(60.0, 100.0, 108.0),))
    return plain._replace(**changes)  # type: ignore[arg-type]  # its own fields


def verdicts(*flown: Score) -> list[str]:
    return [str(claim.verdict) for claim in traffic.findings(flown, 1).claims]


GOOD = Score((scored("one"), scored("glider")), (), {})


def test_what_was_required_holds_when_it_does() -> None:
    assert verdicts(GOOD, GOOD) == ["holds"] * 4


@pytest.mark.parametrize(
    ("bad", "which"),
    [
        (Score(GOOD.aircraft, ("icao/1",), {}), 0),
        (Score((scored("one", missing_s=3.0), scored("glider")), (), {}), 1),
        (Score((scored("one", encounters=(Encounter(60.0, 100.0, 120.0),)), scored("glider")), (), {}), 2),
        (Score((scored("one", encounters=(Encounter(60.0, 100.0, float("nan")),)), scored("glider")), (), {}), 2),
        (Score((scored("one", inside=900), scored("glider", inside=1000)), (), {}), 3),
    ],
)
def test_and_does_not_when_it_does_not(bad: Score, which: int) -> None:
    found = verdicts(bad)
    assert [k for k, verdict in enumerate(found) if verdict == "does not hold"] == [which]


def test_an_approach_is_foretold_well_within_15_m_or_a_tenth() -> None:
    assert Encounter(0.0, 20.0, 34.0).close
    assert not Encounter(0.0, 20.0, 36.0).close
    assert Encounter(0.0, 500.0, 545.0).close
    assert not Encounter(0.0, 500.0, 555.0).close


def test_a_flight_is_scored_seed_101() -> None:
    found = traffic.findings([traffic.fly(101, "ekf", 12.0)], 101)
    assert len(found.tables[0].rows) == 20
    assert found.claims[0].verdict == "holds"
    assert {c.unit for c in found.checks} == {"", "s", "%"}


def test_aircraft_that_only_the_radar_sees_are_known_by_those_that_are_heard_too_seed_102() -> None:
    """Half a degree of our own attitude is 15 m at their distance."""
    told = traffic.fly(102, "imm", 30.0)
    silent = [a for a in told.aircraft if a.name.startswith("crossing-") and a.samples > 100]
    assert len(silent) >= 3
    assert max(a.rmse for a in silent) < 8.0

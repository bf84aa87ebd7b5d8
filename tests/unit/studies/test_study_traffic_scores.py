"""Scores of traffic, against tracks made by hand: each finding is there when it should be, and not else."""

from collections.abc import Callable, Iterable
from typing import Final

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.arrays import Array
from onboard.messages import Estimate, IntruderTruth, TrafficTruth
from studies.traffic.scores import AircraftScore, Encounter, TrafficScore, score_traffic
from tests.support.vehicle_records import APPROACH, INTRUDER, TRAFFIC

SECONDS: Final = 40
NAMES: Final = ("one", "two")
TARGETS: Final = ("icao/000001", "icao/000002")
# Two that fly north in parallel, 300 m apart; sigma of each estimate is 5 m on each axis.
START: Final = np.array([[-900.0, 100.0, 0.0], [-900.0, 400.0, 0.0]])
VELOCITY: Final = np.array([30.0, 0.0, 0.0])
P: Final = tuple(map(tuple, (25.0 * np.eye(6)).tolist()))
NORTH, EAST, DOWN = np.eye(3)
TIMES: Final = np.arange(0, 10 * SECONDS + 1) / 10

Place = Callable[[float], Array]


def place(k: int) -> Place:
    """Where the k-th aircraft is, m."""
    return lambda t: np.asarray(START[k] + VELOCITY * t)


def truths(heard: Callable[[float, int], int] = lambda t, _k: round(10 * t)) -> list[TrafficTruth]:
    """The truth; `heard(t, k)` messages of aircraft k have come until then, by default ten a second."""
    return [
        TrafficTruth(
            t_ns=round(t * 1e9),
            intruders=tuple(
                IntruderTruth(
                    name=NAMES[k],
                    target=TARGETS[k],
                    r_FT_n=tuple(place(k)(t).tolist()),
                    v_FT_n=tuple(VELOCITY.tolist()),
                    messages=heard(t, k),
                    detections=0,
                )
                for k in range(2)
            ),
        )
        for t in TIMES.tolist()
    ]


def reported(target: str, at: Place, times: Iterable[float] = TIMES, *, valid: bool = True) -> list[Estimate]:
    """A track's estimates, between samples of the truth."""
    return [
        replace(
            TRAFFIC,
            target=target,
            t_ns=round(t * 1e9) + 30_000_000,
            mean=(*at(t + 0.03).tolist(), *VELOCITY.tolist()),
            covariance=P,
            valid=valid,
            intruder=replace(INTRUDER, approach=replace(APPROACH, distance=110.0)),
        )
        for t in times
    ]


def score(*tracks: list[Estimate]) -> TrafficScore:
    return score_traffic(sorted((e for track in tracks for e in track), key=lambda e: e.t_ns), truths())


def of(found: TrafficScore, name: str) -> AircraftScore:
    return next(a for a in found.aircraft if a.name == name)


def both() -> tuple[list[Estimate], list[Estimate]]:
    return reported(TARGETS[0], place(0)), reported(TARGETS[1], place(1))


def test_tracks_on_their_own_aircraft_are_faultless() -> None:
    found = score(*both())
    assert (found.swaps, found.false_tracks) == ((), {})
    assert {(a.name, a.tracks, a.missing_s) for a in found.aircraft} == {
        (name, (target,), 0.0) for name, target in zip(NAMES, TARGETS, strict=True)
    }
    assert all(a.inside == a.samples > 300 for a in found.aircraft)
    assert all(a.rmse == pytest.approx(0.0, abs=1e-6) for a in found.aircraft)


@pytest.mark.parametrize(("seconds", "swaps"), [(2.0, (TARGETS[0],)), (0.5, ())])
def test_a_track_on_another_aircraft_for_more_than_a_second_is_swapped(
    seconds: float, swaps: tuple[str, ...]
) -> None:
    def strays(t: float) -> Array:
        return place(1 if 20.0 <= t < 20.0 + seconds else 0)(t)

    assert score(reported(TARGETS[0], strays), both()[1]).swaps == swaps


def test_a_track_that_is_off_and_on_no_other_is_lost_and_not_swapped() -> None:
    found = score(reported(TARGETS[0], lambda t: place(0)(t) - 200.0 * EAST), both()[1])
    assert found.swaps == ()
    assert of(found, "one").inside == 0
    assert of(found, "one").rmse == pytest.approx(200.0)


def test_a_track_of_no_aircraft_is_false_and_counted_with_its_samples() -> None:
    nobody = reported("radar/7", lambda t: place(0)(t) + 900.0 * DOWN, TIMES[100:140])
    assert score(*both(), nobody).false_tracks == {"radar/7": 40}


def test_a_track_without_an_address_is_of_the_aircraft_it_began_at() -> None:
    found = score(both()[0], reported("radar/7", place(1)))
    assert found.false_tracks == {}
    assert of(found, "two").tracks == ("radar/7",)


def test_seconds_without_a_valid_track_are_missing_once_it_could_have_been_tracked() -> None:
    gap = [t for t in TIMES.tolist() if not 20.0 < t < 25.0]
    found = score(reported(TARGETS[0], place(0), gap), both()[1])
    assert of(found, "one").missing_s == pytest.approx(5.0 - 0.5, abs=0.15)
    assert of(found, "one").trackable_s == pytest.approx(SECONDS - 4.0, abs=0.2)
    assert of(found, "two").missing_s == 0.0
    never = score(both()[1])
    assert of(never, "one").missing_s == pytest.approx(SECONDS - 4.0, abs=0.2)  # it had four seconds to begin
    lost = score(reported(TARGETS[0], place(0), valid=False), both()[1])
    assert of(lost, "one").missing_s == of(never, "one").missing_s


def test_what_is_neither_heard_nor_seen_is_not_missing() -> None:
    silent = truths(lambda t, _k: 100 if t < 10.0 else 101)
    found = score_traffic(reported(TARGETS[1], place(1)), silent)
    assert of(found, "one").missing_s == 0.0


def test_an_aircraft_that_was_silent_has_four_seconds_to_begin_again() -> None:
    """Without a message from 10 to 20 s; its track ends while it is silent, and begins again at 23 s."""
    heard = truths(lambda t, _k: 100 if 10.0 <= t < 20.0 else round(10 * t))
    track = reported(TARGETS[0], place(0), [t for t in TIMES.tolist() if not 14.0 < t < 23.0])
    found = of(score_traffic(track, heard), "one")
    assert found.missing_s == 0.0
    assert found.trackable_s == pytest.approx(13.0 - 4.0 + 20.0 - 4.0, abs=0.4)


@pytest.mark.parametrize(("off_m", "share"), [(13.0, 1.0), (15.0, 0.0)])
def test_an_ellipsoid_of_95_per_cent_holds_2_8_sigmas_and_no_more(off_m: float, share: float) -> None:
    found = of(score(reported(TARGETS[0], lambda t: place(0)(t) + off_m * NORTH), both()[1]), "one")
    assert found.samples > 300
    assert found.inside / found.samples == share


def test_an_encounter_has_the_distance_foretold_ten_seconds_before() -> None:
    (met,) = of(score(*both()), "one").encounters
    assert (met.t, met.distance, met.predicted, met.known) == (30.0, 100.0, 110.0, True)
    assert met.predicted_well
    (unknown,) = of(score(reported(TARGETS[0], place(0), TIMES[210:]), both()[1]), "one").encounters
    assert np.isnan(unknown.predicted)
    assert not unknown.predicted_well


def test_an_approach_is_predicted_well_within_15_m_or_a_tenth() -> None:
    assert Encounter(0.0, 20.0, 34.0).predicted_well
    assert not Encounter(0.0, 20.0, 36.0).predicted_well
    assert Encounter(0.0, 500.0, 545.0).predicted_well
    assert not Encounter(0.0, 500.0, 555.0).predicted_well

"""The study of manoeuvres: what its leaders do, what counts of a flight, and what is claimed."""

import numpy as np
import pytest

from onboard.arrays import Array
from studies.closed_loop.flight import Flight
from studies.manoeuvres.flights import MANOEUVRES, SPEEDS, Change, Manoeuvre, Result, Turn, judged, scenario_of
from studies.manoeuvres.study import findings

N = 900
ONES, ZEROS = np.ones(N), np.zeros(N)
T = np.arange(N) / 10.0
GOOD = Flight._make([T, 30.0 * ONES, *(ZEROS,) * 4, ONES, ONES, *(ZEROS,) * 4, ONES, ZEROS, ()])


def test_a_change_takes_its_time_and_a_turn_its_lateral_acceleration() -> None:
    stops = Change(45.0, -1.0, 2.0).of(6.0)  # 3 m/s^2 on the average
    assert (stops.start, stops.end - stops.hold - stops.start, stops.change) == (45.0, 4.0, -6.0)
    turn = Turn(0.2, 40.0, 10.0).of(5.0)
    assert (turn.start, turn.hold, turn.change) == (40.0, 10.0, 1.0)


@pytest.mark.parametrize("manoeuvre", MANOEUVRES, ids=lambda m: m.name)
def test_every_flight_begins_behind_a_leader_at_rest(manoeuvre: Manoeuvre) -> None:
    for autopilot, speed in SPEEDS.items():
        scenario = scenario_of(autopilot, manoeuvre)
        assert scenario.vehicle.autopilot == autopilot
        assert (scenario.leader.speed, scenario.leader.climb_pulses) == (0.0, ())
        assert scenario.leader.speed_pulses[0].start == 25.0
        assert abs(scenario.leader.speed_pulses[0].change) == (4.0 if manoeuvre.backs_up else speed)
        assert scenario.follow is not None
        assert scenario.follow.offset == scenario.follower.slot
        assert scenario.follow.engage == 10.0
        assert scenario.repeat > scenario.duration  # else it begins anew before its end


def test_distances_count_once_the_mode_has_settled() -> None:
    slot = float(np.linalg.norm((-30.0, 0.0, 2.0)))
    distance = np.where(T < 14.0, 1.0, np.where(T < 50.0, 0.8 * slot, 1.2 * slot))
    off = slot * np.where(T < 14.0, 1.0, np.where(T < 60.0, 0.1, 0.2))
    found = judged(GOOD._replace(distance=distance, slot_error=off))
    assert (found.off, found.farthest_off) == (pytest.approx(10.0), pytest.approx(20.0))
    assert (found.least, found.greatest) == (pytest.approx(80.0), pytest.approx(120.0))
    assert (found.seen, found.valid, found.followed) == (100.0, 100.0, True)


def test_advice_about_a_set_up_that_is_right_is_counted() -> None:
    assert judged(GOOD._replace(advice=("noise", "pixels"))).advised == 2


@pytest.mark.parametrize(
    "end",
    [
        {"valid": np.where(T > 86.0, 0.0, 1.0)},
        {"in_view": np.where(T > 86.0, 0.0, 1.0)},
        {"following": np.where(T > 86.0, 0.0, 1.0)},
        {"distance": np.where(T > 86.0, 46.0, 30.0)},
        {"distance": np.where(T > 86.0, 14.0, 30.0)},
        {"aside": np.where(T > 86.0, 1.1, 0.0)},  # rad
    ],
)
def test_followed_is_what_is_seen_valid_and_near_its_slot_at_the_end(end: dict[str, Array]) -> None:
    assert not judged(GOOD._replace(**end)).followed


def test_one_flight_that_misses_takes_the_claim_away() -> None:
    good = Result(
        least=70.0, greatest=150.0, off=5.0, farthest_off=50.0, seen=100.0, valid=100.0, aside=0.0, followed=True
    )
    bad = Result(
        least=60.0,
        greatest=230.0,
        off=50.0,
        farthest_off=250.0,
        seen=90.0,
        valid=100.0,
        aside=90.0,
        followed=False,
        advised=1,
    )
    rows = [(name, m, [good, bad if m.name.startswith("circle") else good]) for name in SPEEDS for m in MANOEUVRES]
    found = findings([row if row[0] == "px4" else (*row[:2], [good, good]) for row in rows], 501)
    assert [claim.verdict for claim in found.claims] == ["holds"] * 4 + ["does not hold"] * 4
    assert found.claims[4].evidence == "misses: circle at 0.125 rad/s; circle at 0.2 rad/s"
    assert found.tables[0].rows[-1][2:6] == (2.0, 2.0, 70.0, 70.0)

"""The scores of the own-state study: names, times, errors."""

import pytest

from onboard.messages import FaultKind, NavState, Truth
from simlink.scenarios.scenario import load_scenario
from studies.own_state import flights

MOTOR = (FaultKind.MOTOR, "motor 1")
Flight = tuple[list[NavState], list[Truth]]


@pytest.fixture(scope="module")
def flight() -> Flight:
    (states,), truths = flights.fly(load_scenario("quadrotor-motor"), 3, 12.0, ["csvsf-adaptive"])
    return states, truths


def test_a_motor_loss_is_named_in_time_seed_3(flight: Flight) -> None:
    judged = flights.judge(*flight, MOTOR)
    assert judged.named
    assert 0.1 < judged.delay < 0.6
    assert abs(judged.onset) < 0.2
    assert judged.wrong == ()
    assert judged.watched == pytest.approx(12.0, abs=0.05)
    assert 0.01 < judged.velocity <= judged.worst < 0.5


def test_a_name_that_is_not_expected_is_wrong_seed_3(flight: Flight) -> None:
    assert flights.judge(*flight, None).wrong == ("motor motor 1",)
    other = flights.judge(*flight, (FaultKind.MOTOR, "motor 2"))
    assert (other.named, other.wrong) == (False, ("motor motor 1",))
    states, truths = flight
    silent = flights.judge([s for s in states if not s.faults], truths, MOTOR)
    assert not silent.named


def test_without_the_barometer_its_updates_are_off() -> None:
    alone = flights.section(flights.DEFAULT + flights.NO_BAROMETER)
    assert alone == {**flights.section(flights.DEFAULT), "pressure_rate_hz": 0.0}


def test_records_hold_the_vertical_velocity_that_mavlink_lacks_seed_3() -> None:
    scenario = load_scenario("quadrotor")
    for vertical, components in ((False, 5), (True, 6)):
        (states, others), _ = flights.fly(scenario, 3, 1.5, ["cubature", "csvsf"], vertical)
        assert len(states) == len(others)
        assert states != others  # each by its own filter
        fixes = [s.measurement for s in states if s.measurement is not None and s.measurement.source == "gps"]
        assert {len(m.components) for m in fixes if m.components} == {components}

"""A battery's voltage on its way from SYS_STATUS to the motors' thrust."""

from msgspec.structs import replace

from onboard.messages import Datagram, NavState
from simlink.scenarios.scenario import Scenario, load_scenario
from tests.support import kept
from tests.support.own_vehicle import pipeline

LOW_V = 10.54  # 0.7 of the thrust: without its voltage, the fault "mass"
SECONDS = 2.5


def low() -> Scenario:
    """A flight that begins with an empty battery."""
    scenario = load_scenario("quadrotor-battery")
    assert scenario.quadrotor is not None
    craft = replace(scenario.quadrotor, battery=replace(scenario.quadrotor.battery, minutes=0.01, empty=LOW_V))
    rates = replace(scenario.vehicle.rates, battery=5.0)
    return replace(scenario, quadrotor=craft, vehicle=replace(scenario.vehicle, rates=rates))


def test_an_empty_battery_is_no_fault_seed_5() -> None:
    p = pipeline(gps_s=0.1, airframe="csvsf", publish_rate_hz=10.0)
    flown = [d for d in kept.flight(low(), 5, SECONDS, camera="none") if isinstance(d, Datagram)]
    states = [o for d in flown for o in p.feed(d) if isinstance(o, NavState)]
    assert not p.errors
    assert states[-1].valid
    assert not any(state.faults for state in states)

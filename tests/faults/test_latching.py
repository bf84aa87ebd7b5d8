"""Which autopilot is ours: vehicles only, and another one when ours has fallen silent for good."""

from itertools import pairwise, product
from typing import Any, NamedTuple

import pytest
from msgspec.structs import replace

from onboard.messages import Attitude, Datagram, Heartbeat, LocalPosition
from onboard.messages.causes import Cause
from tests.faults.test_silence import flying
from tests.support.cases import slow_but
from tests.support.faulty_flight import DATAGRAMS, ITEMS, SHARED, T0, T1, assert_on_target, flown
from tests.support.streams import EPOCH, Item, Run, S, Stream, encode, feed, heartbeat, make_config

NO_VEHICLES = GIMBAL, CAMERA, CONTROLLER, GROUND, ADSB, ODID = 26, 30, 18, 6, 27, 34


def beat(t_s: float, *, system: int = 1, component: int = 154, kind: int, autopilot: int = 0) -> Datagram:
    t_ns = round(t_s * S)
    message = replace(heartbeat(t_ns, system=system, autopilot=autopilot), component=component, vehicle_type=kind)
    return encode([Item(EPOCH + t_ns, message)])[0]


@pytest.mark.parametrize("kind", NO_VEHICLES)
@pytest.mark.parametrize("system", [1, 7])
def test_a_heartbeat_of_no_vehicle_is_not_latched(kind: int, system: int) -> None:
    assert feed([beat(39.9, system=system, kind=kind)]).pipeline.autopilot is None


@pytest.mark.parametrize("kind", [0, 1, 2, 3, 4, 7, 10, 12, 13, 14, 19, 22, 29, 35, 43])
def test_vehicles_are_latched(kind: int) -> None:
    run = feed([beat(39.9, system=3, component=1, kind=kind)])
    assert isinstance(run.pipeline.autopilot, Heartbeat)
    assert run.pipeline.autopilot.vehicle_type == kind


class Again(NamedTuple):
    """The start of another flight by an autopilot with other ids, `gap` seconds after the first one ends."""

    gap: float
    system: int = 2
    component: int = 1


def after(again: Again, config: Any = None) -> Run:
    sent = [*DATAGRAMS, *flight_of(again)]
    return SHARED.run(sent) if config is None else feed(sent, config)


def flight_of(again: Again) -> list[Datagram]:
    """Its own motion and images, with the new ids."""
    late = round((T1 - 6.0 + again.gap) * S)
    items = Stream(t0=6.0, t1=14.0, seed=22, sparse=True).items()
    moved = [
        Item(
            i.t_recv_ns + late,
            replace(i.message, system=again.system, component=again.component)
            if i.message.component == 1
            else replace(i.message, system=again.system),
        )
        for i in items
    ]
    return encode(moved)


@pytest.mark.parametrize(("system", "component"), slow_but([(2, 1)], [(2, 1), (1, 2), (250, 1)]))
def test_an_autopilot_that_returns_with_another_id_is_latched_after_silence(system: int, component: int) -> None:
    run = after(Again(gap=8.0, system=system, component=component))
    latched = run.pipeline.autopilot
    assert latched is not None
    assert (latched.system, latched.component) == (system, component)
    assert_on_target(run)
    assert run.estimates[-1].t_ns < 14 * S
    assert run.estimates[-1].reset_count == 1


def test_another_autopilot_is_not_latched_while_ours_talks() -> None:
    strangers = [beat(t, system=9, component=1, kind=2, autopilot=12) for t in range(round(T0) + 1, 52)]
    run = flown(sorted([*DATAGRAMS, *strangers], key=lambda d: d.t_recv_ns))
    assert_on_target(run, 1.0)
    assert run.pipeline.autopilot is not None
    assert run.pipeline.autopilot.system == 1


FORGED = {
    "another system": {"system": 66, "component": 1, "kind": 2, "autopilot": 3},
    "another system, of no known kind": {"system": 66, "component": 1, "kind": 2, "autopilot": 0},
    "our gimbal, as a generic autopilot": {"system": 1, "component": 154, "kind": 2, "autopilot": 0},
    "component 2 of our system": {"system": 1, "component": 2, "kind": 2, "autopilot": 12},
}


@pytest.mark.parametrize(
    ("forged", "moves"),
    slow_but(
        [
            ("another system", False),
            ("our gimbal, as a generic autopilot", True),
            ("component 2 of our system", True),
        ],
        product(FORGED, [False, True]),
    ),
)
def test_who_speaks_first_and_is_not_our_autopilot_is_let_go(forged: str, moves: bool) -> None:
    """It speaks for as long as the flight lasts; with its own attitude it is told from ours in our system only."""
    ids = FORGED[forged]
    beats = [beat(t, **ids) for t in range(round(T0) - 2, 52)]
    attitudes = [
        encode([Item(i.t_recv_ns, replace(i.message, system=ids["system"], component=ids["component"]))])[0]
        for i in ITEMS
        if isinstance(i.message, Attitude) and moves and ids["system"] == 1
    ]
    run = flown(sorted([*beats, *attitudes, *DATAGRAMS], key=lambda d: d.t_recv_ns))
    latched = run.pipeline.autopilot
    assert latched is not None
    assert (latched.system, latched.component) == (1, 1)
    assert_on_target(run)
    assert next(e for e in run.estimates if e.valid).t_ns < (T0 + 5.0) * S
    (other,) = run.pipeline.health(0).beside
    assert other.endswith(f"system {ids['system']}")


def test_ours_without_a_position_is_not_left_for_a_wingman_that_has_one() -> None:
    theirs = encode([Item(i.t_recv_ns, replace(i.message, system=9)) for i in ITEMS])
    ours = encode([i for i in ITEMS if not isinstance(i.message, LocalPosition)])
    run = feed(sorted([*ours, *theirs], key=lambda d: d.t_recv_ns))
    assert run.pipeline.autopilot is not None
    assert run.pipeline.autopilot.system == 1


def test_a_flood_of_heartbeats_hides_no_autopilot() -> None:
    beats = [
        beat(T0 - 1 + 0.01 * k, system=2 + k % 250, component=1, kind=2, autopilot=12)
        for k in range(round(100 * (T1 - T0 + 1)))
    ]
    run = flown(sorted([*beats, *DATAGRAMS], key=lambda d: d.t_recv_ns))
    assert run.pipeline.autopilot is not None
    assert run.pipeline.autopilot.system == 1
    assert len(run.pipeline.health(0).beside) < 20


def test_a_configured_system_is_never_left() -> None:
    run = after(Again(gap=8.0, system=2), config=make_config("autopilot.system=1"))
    assert run.pipeline.autopilot is not None
    assert run.pipeline.autopilot.system == 1


def test_the_daemon_says_which_autopilot_it_follows() -> None:
    daemon, _, lines = flying()
    for datagram in flight_of(Again(gap=8.0, system=2)):
        daemon._deliver(datagram)
    reported = [line for line in lines if line.startswith("autopilot")]
    assert reported == ["autopilot: PX4, system 1", "autopilot: PX4, system 2 (the one before has fallen silent)"]


def renamed(pause: float, system: int, component: int, change: Any = None) -> list[Datagram]:
    """The flight, whose autopilot has another id from its third second on, after a pause; `change`: of what it
    says from then on."""
    at_ns = EPOCH + round((T0 + 3.0) * S)
    items = []
    for item in LONG:
        message = item.message
        if item.t_recv_ns < at_ns:
            items.append(item)
        elif message.component != 1:  # the camera
            items.append(Item(item.t_recv_ns, replace(message, system=system)))
        elif item.t_recv_ns >= at_ns + round(pause * S):
            message = message if change is None else change(message)
            items.append(Item(item.t_recv_ns, replace(message, system=system, component=component)))
    return encode(items)


LONG = Stream(t0=T0, t1=T0 + 14.0, seed=23, sparse=True).items()


@pytest.mark.parametrize(
    ("pause", "system", "component"), slow_but([(0.0, 2, 1)], [(0.0, 2, 1), (0.0, 1, 2), (3.0, 2, 1), (6.0, 7, 1)])
)
def test_an_autopilot_that_goes_on_with_another_id_costs_nothing_that_was_learnt(
    pause: float, system: int, component: int
) -> None:
    """Its parameters were loaded late, after it had spoken for some seconds. It was taken for another vehicle: the
    clocks, our own motion and the leader began anew."""
    run = flown(renamed(pause, system, component))
    assert run.pipeline.autopilot is not None
    assert (run.pipeline.autopilot.system, run.pipeline.autopilot.component) == (system, component)
    assert "another id" in run.pipeline.why_followed
    assert not [e.reason for e in run.estimates if e.cause is Cause.OTHER_AUTOPILOT]
    assert run.estimates[-1].reset_count == (pause > 0.0)  # silence for so long costs the track in any case
    gap = max(b.t_ns - a.t_ns for a, b in pairwise([e for e in run.estimates if e.valid])) / S
    assert gap < pause + 2.5  # the second heartbeat with the new id
    assert_on_target(run)


def later_boot(message: Any) -> Any:
    return replace(message, t_ns=message.t_ns - 5 * S) if message.t_ns > 10 * S else message


def elsewhere(message: Any) -> Any:
    north, east, down = getattr(message, "r_OF_n", (0.0, 0.0, 0.0))
    return replace(message, r_OF_n=(north + 5.0, east, down)) if isinstance(message, LocalPosition) else message


def otherwise_turned(message: Any) -> Any:
    return replace(message, q_nb=(0.0, 0.0, 0.0, 1.0)) if isinstance(message, Attitude) else message


def faster(message: Any) -> Any:
    if not isinstance(message, LocalPosition):
        return message
    north, east, down = message.v_F_n
    return replace(message, v_F_n=(north + 9.0, east, down))


def of_another_make(message: Any) -> Any:
    return replace(message, autopilot=3) if isinstance(message, Heartbeat) else message


@pytest.mark.parametrize("change", [later_boot, elsewhere, otherwise_turned, faster, of_another_make])
def test_another_vehicle_that_comes_after_ours_begins_anew(change: Any) -> None:
    """Whatever does not go on: the clock, the position, the attitude, the velocity, the make."""
    run = flown(renamed(0.0, 2, 1, change))
    assert run.pipeline.autopilot is not None
    assert run.pipeline.autopilot.system == 2
    assert run.pipeline.why_followed == "the one before has fallen silent"
    assert [e for e in run.estimates if e.cause is Cause.OTHER_AUTOPILOT]

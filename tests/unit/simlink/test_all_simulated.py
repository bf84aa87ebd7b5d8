"""Every field of every message of every scenario, family and departure, as a few digits.

A change of the simulator shows here; that it is right is shown beside this file, by hand and by other formulas.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator
from typing import Any

import msgspec
import pytest

from simlink.encounters.departures import NO_DEPARTURE, Departure
from simlink.encounters.encounter import Encounter, make_encounter
from simlink.encounters.families import FAMILIES
from simlink.scenarios.profiles import GaussMarkov
from simlink.scenarios.scenario import load_scenario, scenario_names
from simlink.simulation import simulate
from tests.support.golden import assert_golden, numbers

WITHOUT_PICTURES = [name for name in scenario_names() if not name.startswith("pictures")]
DEPARTURES = {
    "drag": Departure(drag=0.6),
    "wind": Departure(wind=8.0),
    "nose": Departure(any_nose=True),
    "size": Departure(size_off=0.3),
    "vigour": Departure(vigour=2.0, wobble=3.0),
    "images": Departure(image_noise=2.0, image_noise_time=0.5, stamp_late=0.03),
    "own": Departure(own_errors=2.0, own_errors_time=4.0, attitude_white_deg=0.5, mount_off_deg=2.0),
    "yaw": Departure(yaw_leads=0.5, nose_slack_deg=10.0, nose_rate=0.8, nose_turns=0.5),
    "acceleration": Departure(acceleration=1.0, bank=GaussMarkov(sigma=5.0, time=1.0)),
    "hand": Departure(jitter=0.4, sail=0.2, sway=3.0),
}


def leaves(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """The numbers and words in a record, by their places."""
    if isinstance(value, msgspec.Struct):
        for field in value.__struct_fields__:
            yield from leaves(getattr(value, field), f"{name}.{field}" if name else field)
    elif isinstance(value, tuple | list):
        for one in value:
            yield from leaves(one, name)
    elif isinstance(value, dict):
        for key, one in value.items():
            yield from leaves(one, f"{name}.{key}")
    elif value is not None:
        yield name, value


def digest(events: Iterable[tuple[int, Any]]) -> Iterator[str]:
    """A line for each field of each kind of record: its numbers, or its words with their counts."""
    columns = defaultdict[tuple[str, str], list[Any]](list)
    for t_ns, record in events:
        kind = type(record).__name__
        columns[kind, "at"].append(1e-9 * t_ns)
        for name, value in leaves(record):
            columns[kind, name].append(value)
    for (kind, name), values in sorted(columns.items()):
        if isinstance(values[0], str | bytes):
            words = sorted({str(value) for value in values})
            yield f"{kind} {name}: {len(values)} {words[:4]}"
        else:
            yield f"{kind} {name}: {numbers(values)}"


@pytest.mark.parametrize("group", ["formation", "guided", "quadrotor", "others"])
def test_scenarios_seed_1(group: str) -> None:
    known = ("formation", "guided", "quadrotor")
    chosen = [n for n in WITHOUT_PICTURES if (n.startswith(group) if group in known else not n.startswith(known))]
    lines, whole = [], set[str]()
    for name in chosen:
        scenario = load_scenario(name)
        found = digest((event.t_ns, event.message) for event in simulate(scenario, 1, 3.0, "zenoh"))
        new = [line for line in found if line not in whole]  # what is as in an earlier one is not repeated
        whole |= {*new}
        lines += [f"SCENARIO {name}", *new]
    assert_golden(f"simulated-{group}.txt", lines)


def flown(encounter: Encounter) -> Iterator[str]:
    """What was drawn, and both ways."""
    yield f"{encounter.leader_class} drag {encounter.drag:.5g} manoeuvre {encounter.manoeuvre}"
    yield from digest([(0, encounter.scenario)])
    for name, part in encounter.truth._asdict().items():
        for k, values in enumerate(part if isinstance(part, tuple) else [part]):
            if values is not None:
                yield f"truth {name} {k}: {numbers(values[::20])}"


def sent(encounter: Encounter) -> str:
    """When datagrams arrive, and the sums of their bytes."""
    found = [*encounter.datagrams()]
    return f"sent {numbers([d.t_recv_ns * 1e-9 % 1e6 for d in found])} {numbers([sum(d.data) for d in found])}"


def test_encounters_seed_1() -> None:
    cases = {name: (make_encounter(name, 1, 30.0), make_encounter(name, 1, 3.0)) for name in FAMILIES}
    boxes = make_encounter("stops", 2, 30.0, "rotor_box", mount="gimbal")
    cases |= {"boxes on a gimbal": (boxes, boxes)}
    for name, departure in ({"no departure": NO_DEPARTURE} | DEPARTURES).items():
        cases[name] = (make_encounter("crossing", 3, 6.0, departure=departure),) * 2
    lines, whole = [], set[str]()
    for name, (long, short) in cases.items():
        new = [line for line in (*flown(long), sent(short)) if line not in whole]
        whole |= {*new}
        lines += [f"CASE {name}", *new]
    assert_golden("encounters.txt", lines)

"""All that the view draws of a flight made by hand: every entity, row and word, and each window."""

from collections import defaultdict
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from onboard.messages import Advice, Estimate, Fault, FaultKind, Health, Severity, ThreatLevel
from tests.support.golden import assert_golden, numbers, rounded
from tests.support.vehicle_records import APPROACH, INTRUDER, TRAFFIC, nav_state
from tests.support.view_flight import CAMERA, NEEDS_RERUN, flight

layout = pytest.importorskip("onboard.view.layout", reason=NEEDS_RERUN, exc_type=ImportError)
view_module = pytest.importorskip("onboard.view.view", reason=NEEDS_RERUN, exc_type=ImportError)
chunk = pytest.importorskip("rerun.chunk", reason=NEEDS_RERUN)

S = 1_000_000_000
ROTORS = ((0.2, 0.0, 1), (0.0, 0.2, -1), (-0.2, 0.0, 1), (0.0, -0.2, -1))
MOTOR = Fault(kind=FaultKind.MOTOR, part="motor 2", t_onset_ns=20 * S, magnitude=0.243, unit="lost")
ADVICE = Advice(
    kind="noise", severity=Severity.WARNING, about="camera", what="it is noisy", remedy="clean it", text="noisy"
)
VARIANCES = tuple(tuple(float(10 * (i + 1) * (i == j)) for j in range(6)) for i in range(6))


def records() -> Iterator[Any]:
    """A flight behind a leader for 20 s, another estimator beside, our own state, and other aircraft."""
    for record in flight(20.0):
        yield record
        t_ns = record.t_ns
        if isinstance(record, Health):
            near = replace(APPROACH, distance=400.0 - 1e-8 * t_ns, threat=ThreatLevel.LOW)
            for k, approach in enumerate((near, replace(APPROACH, threat=ThreatLevel.NONE), APPROACH)):
                r = (200.0 - 300.0 * k, -400.0 + 1e-8 * t_ns, -50.0 * k)
                who = replace(INTRUDER, callsign="" if k else "HB|ABC", approach=approach)
                known: dict[str, Any] = {"mean": (*r, 10.0, 0.0, 0.0), "covariance": VARIANCES}
                if k == 2 and t_ns > 20 * S:
                    known = {"mean": None, "covariance": None, "valid": False}
                yield replace(TRAFFIC, target=f"icao/{k}", t_ns=t_ns, intruder=who, **known)
            yield replace(record, advice=(ADVICE,) if t_ns > 22 * S else ())
        if isinstance(record, Estimate):
            faults = (MOTOR,) if t_ns > 21 * S else ()
            yield nav_state(t_ns // 1_000_000, faults=faults, valid=not 25 * S < t_ns < 26 * S)
            if record.mean is not None:
                mean = tuple(1.1 * value for value in record.mean)
                yield replace(record, name="paper", target="paper", mean=mean, valid=t_ns < 30 * S)


def columns(path: Path) -> Iterator[str]:
    """Each column of each entity of a recording: number of rows, and numbers or first and last words."""
    found = defaultdict[tuple[str, str], list[tuple[timedelta, Any]]](list)
    for one in chunk.RrdReader(path).stream().to_chunks():
        batch = one.to_record_batch().to_pydict()
        times = batch.get("boot_time", [timedelta()] * one.num_rows)
        entity = one.entity_path + (" static" if one.is_static else "")
        for name in batch.keys() - {"boot_time"}:
            if not name.startswith(("rerun", "log_t", "frame")) and not entity.startswith("/__properties"):
                found[entity, name] += zip(times, batch[name], strict=True)
    for (entity, name), rows in sorted(found.items()):
        flat = [*flattened([value for _, value in sorted(rows, key=lambda row: row[0])])]
        words = [value for value in flat if isinstance(value, str)]
        shown = " | ".join(dict.fromkeys((*words[:1], *words[-1:]))).replace("\n", "~") if words else numbers(flat)
        yield rounded(f"{entity} {name} {len(rows)}: {shown}")


def flattened(values: Any) -> Iterator[Any]:
    """Numbers and words in lists of lists; of bytes their number."""
    if isinstance(values, (list, tuple)):
        for value in values:
            yield from flattened(value)
    elif isinstance(values, dict):
        yield from flattened(list(values.values()))
    elif isinstance(values, bytes):
        yield len(values)
    elif values is not None:
        yield values


def test_all_that_is_drawn(tmp_path: Path) -> None:
    with view_module.View(camera=CAMERA, rotors=ROTORS, rrd=tmp_path / "flight.rrd") as view:
        for record in records():
            view.show(record)
    assert_golden("view.txt", columns(tmp_path / "flight.rrd"))


def parts(part: Any, depth: int = 0) -> Iterator[str]:
    """A container or view as a line, and below it all that is in it."""
    kept = ("name", "origin", "active_tab", "row_shares", "column_shares", "contents", "properties", "overrides")
    facts = {name: value for name in kept if (value := getattr(part, name, None)) is not None}
    inner = facts.pop("contents", ()) if hasattr(part, "row_shares") else ()
    words = " ".join(f"{type(part).__name__} {facts}".split())
    yield f"{'  ' * depth}{rounded(words)}"
    for one in inner:
        yield from parts(one, depth + 1)


def test_each_window() -> None:
    shown = {
        "nothing": layout.Contents(leader=False),
        "leader": layout.Contents(),
        "own": layout.Contents(leader=False, own=True),
        "traffic": layout.Contents(leader=False, traffic=True),
        "all": layout.Contents(own=True, traffic=True, threat=True, fleet=True, truth=True),
        "own and truth": layout.Contents(leader=False, own=True, truth=True, fleet=True),
    }
    lines = []
    for name, contents in shown.items():
        window = layout.blueprint(CAMERA, contents, beside=(("paper|*", "lime"),) if name == "all" else ())
        lines += [f"WINDOW {name}", *parts(window.root_container)]
    assert_golden("windows.txt", lines)

"""Other aircraft on a north-up map about us, and in a table by closest approach."""

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.messages import Estimate, Lifecycle, ThreatLevel
from onboard.view import palette, scene
from onboard.view.columns import Columns, texts
from onboard.view.memory import Memory
from onboard.view.sdk import rr

MAP: Final = "traffic/map"
TRAFFIC_TABLE: Final = "traffic/table"
RING_RADII: Final = (500.0, 1000.0, 2000.0, 4000.0)  # m
MAP_WIDTH: Final = 6000.0  # m
MAP_RATE_HZ: Final = 4.0
PREDICTION_TIME_S: Final = 20.0  # length of the lines of relative motion
MAX_ROWS: Final = 20
THREATS: Final = {ThreatLevel.HIGH: palette.RED, ThreatLevel.LOW: palette.AMBER}


class Marks(NamedTuple):
    """Labelled points of a map (n, 2), each with its colour."""

    places: Array
    colours: Sequence[palette.Colour]
    labels: Sequence[str]


def marks(values: Sequence[Marks]) -> Any:
    """Columns of labelled points."""
    lengths = [len(v.places) for v in values]
    return [
        *rr.Points2D.columns(positions=np.concatenate([v.places.reshape(-1, 2) for v in values])).partition(
            lengths
        ),
        *rr.Points2D.columns(colors=_colours([v.colours for v in values])).partition(lengths),
        *rr.Points2D.columns(labels=[text for v in values for text in v.labels]).partition(lengths),
    ]


def lines(values: Sequence[tuple[Sequence[Array], Sequence[palette.Colour]]]) -> Any:
    """Columns of any number of lines (n, 2), each with its colour."""
    lengths = [len(strips) for strips, _ in values]
    return [
        *rr.LineStrips2D.columns(strips=[strip for strips, _ in values for strip in strips]).partition(lengths),
        *rr.LineStrips2D.columns(colors=_colours([colours for _, colours in values])).partition(lengths),
    ]


def log_static(stream: "rr.RecordingStream") -> None:
    """Log range rings and our own position."""
    around = np.linspace(0.0, 2 * np.pi, 97)
    circle = np.column_stack([np.cos(around), np.sin(around)])
    rings = [radius * circle for radius in RING_RADII]
    stream.log(f"{MAP}/rings", rr.LineStrips2D(rings, colors=palette.GRID_COLOUR), static=True)
    numbers = [f"{radius:.0f} m" for radius in RING_RADII]
    places = [[0.0, -radius] for radius in RING_RADII]
    stream.log(f"{MAP}/numbers", rr.Points2D(places, labels=numbers, colors=palette.FAINT), static=True)
    stream.log(f"{MAP}/us", rr.Points2D([[0.0, 0.0]], labels="us", colors=palette.OWN_COLOUR), static=True)


def draw_traffic(columns: Columns, memory: Memory, estimate: Estimate) -> None:
    """Store one track, and draw all of them at the map's rate."""
    memory.traffic[estimate.target] = estimate
    if estimate.mean is None:
        del memory.traffic[estimate.target]
    t_ns = estimate.t_ns
    if not memory.is_due("traffic", t_ns, MAP_RATE_HZ):
        return
    tracks = list(memory.traffic.values())
    colours = [colour_of(e) for e in tracks]
    mean = np.array([e.mean for e in tracks], dtype=float).reshape(-1, 6)
    places, ways = on_map(mean[:, :3]), on_map(mean[:, 3:])
    columns.add(marks, f"{MAP}/aircraft", t_ns, Marks(places, colours, [label(e) for e in tracks]))
    along = [np.stack([place, place + PREDICTION_TIME_S * way]) for place, way in zip(places, ways, strict=True)]
    columns.add(lines, f"{MAP}/ways", t_ns, (along, [palette.shade(c, 0.7) for c in colours]))
    around = [place + ellipse(e) for place, e in zip(places, tracks, strict=True)]
    columns.add(lines, f"{MAP}/ellipses", t_ns, (around, [palette.UNCERTAIN] * len(around)))
    columns.add(texts, TRAFFIC_TABLE, t_ns, table(tracks))


def on_map(vectors: Array) -> Array:
    """Convert NED (n, 3) to map coordinates (n, 2): east right, north up (negative y)."""
    return np.column_stack([vectors[:, 1], -vectors[:, 0]])


def ellipse(estimate: Estimate) -> Array:
    """Return the outline (33, 2) of three sigma of the position on the map."""
    around = np.linspace(0.0, 2 * np.pi, 33)
    circle = np.stack([np.cos(around), np.sin(around)])
    P = np.array(estimate.covariance)[:2, :2]
    values, vectors = np.linalg.eigh(P)
    level = (vectors * scene.DRAWN_SIGMAS * np.sqrt(np.maximum(values, 0.0))) @ circle
    return on_map(level.T)


def colour_of(estimate: Estimate) -> palette.Colour:
    """Return red or amber for threats, grey if not valid, else green or violet."""
    if not estimate.valid:
        return palette.GREY
    threat = estimate.intruder.approach.threat if estimate.intruder else ThreatLevel.NONE
    return THREATS.get(threat, palette.GREEN if estimate.state is Lifecycle.TRACKING else palette.VIOLET)


def label(estimate: Estimate) -> str:
    """Return the aircraft's name and its height above us, m."""
    assert estimate.mean is not None  # noqa: S101 - estimates without one are not drawn
    callsign = estimate.intruder.callsign if estimate.intruder else ""
    return f"{callsign or estimate.target} {-estimate.mean[2]:+.0f} m"


def table(tracks: Sequence[Estimate]) -> str:
    """Return the tracks as Markdown, with the nearest closest approach first."""
    rows = ["| aircraft | state | distance | closest | in | sources |", "|---|---|---|---|---|---|"]
    known = [(e, e.intruder) for e in tracks if e.intruder is not None]
    for e, who in sorted(known, key=lambda pair: pair[1].approach.distance)[:MAX_ROWS]:
        a = who.approach
        strong = "**" if a.threat is not ThreatLevel.NONE else ""
        distance = np.linalg.norm(np.array(e.mean)[:3])
        rows.append(
            f"| {strong}{who.callsign or e.target}{strong} | {e.state} | {distance:.0f} m "
            f"| {a.distance:.0f} ±{a.distance_sigma:.0f} m | {a.time:.0f} s | {', '.join(who.sources)} |"
        )
    return "\n".join(rows)


def _colours(rows: Sequence[Sequence[palette.Colour]]) -> Array:
    flat = [colour[:3] for row in rows for colour in row]
    return np.array(flat, dtype=np.uint8).reshape(-1, 3)  # type: ignore[return-value]  # bytes, as Rerun expects

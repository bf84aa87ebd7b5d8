"""Rows gathered into columns and sent together.

Logging one row of one entity costs 30 to 150 us, a row of a column only a few. Rows are therefore collected over a
tenth of a second of flight. The kind of a row is the function that turns its values into columns.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from onboard.arrays import Array
from onboard.view.sdk import rr

TIMELINE = "boot_time"

Kind = Callable[[Sequence[Any]], Any]


class Transform(NamedTuple):
    """The pose of an entity in its parent: translation (m), quaternion (scalar first), scale."""

    translation: ArrayLike
    q: ArrayLike
    scale: ArrayLike


class ImagePoints(NamedTuple):
    """Points in the image (n, 2), px, their colour, and a label of the first."""

    positions: Array
    colour: tuple[int, ...]
    label: str = ""


UNROTATED_WXYZ = (1.0, 0.0, 0.0, 0.0)
# An entity without a position must not be drawn at the origin. The viewer ignores a scale of zero, which has no
# inverse, so it is drawn with a scale of a micrometre.
HIDDEN = Transform((0.0, 0.0, 0.0), UNROTATED_WXYZ, (1e-6, 1e-6, 1e-6))


def scalars(values: Sequence[ArrayLike]) -> Any:
    """Columns of time series; each value holds one number per curve."""
    rows = [np.atleast_1d(np.asarray(v, dtype=float)) for v in values]
    return rr.Scalars.columns(scalars=np.concatenate(rows)).partition([len(r) for r in rows])


def transforms(values: Sequence[Transform]) -> Any:
    """Columns of transforms. Rerun's quaternions are scalar last."""
    q = np.array([v.q for v in values], dtype=float)
    return rr.Transform3D.columns(
        translation=np.array([v.translation for v in values], dtype=float),
        quaternion=q[:, [1, 2, 3, 0]],
        scale=np.array([v.scale for v in values], dtype=float),
    )


def image_points(values: Sequence[ImagePoints]) -> Any:
    """Columns of coloured image points; an empty row removes the previous points."""
    lengths = [len(v.positions) for v in values]
    colours = [v.colour for v in values for _ in v.positions]
    positions = np.concatenate([np.asarray(v.positions, dtype=float).reshape(-1, 2) for v in values])
    return [
        *rr.Points2D.columns(positions=positions).partition(lengths),
        *rr.Points2D.columns(colors=np.array(colours, dtype=np.uint8).reshape(-1, 3)).partition(lengths),
    ]


def labels(values: Sequence[ImagePoints]) -> Any:
    """Columns of one labelled point each."""
    return rr.Points2D.columns(
        positions=np.concatenate([v.positions for v in values]),
        colors=np.array([v.colour for v in values], dtype=np.uint8),
        labels=[v.label for v in values],
    )


def discs(values: Sequence[tuple[Sequence[tuple[int, ...]], Sequence[str]]]) -> Any:
    """Columns of the colours and labels of image points with constant positions."""
    lengths = [len(colours) for colours, _ in values]
    colours = np.array([colour for row, _ in values for colour in row], dtype=np.uint8)
    return [
        *rr.Points2D.columns(colors=colours.reshape(-1, 3)).partition(lengths),
        *rr.Points2D.columns(labels=[label for _, row in values for label in row]).partition(lengths),
    ]


def pictures(values: Sequence[bytes]) -> Any:
    """Columns of JPEG files."""
    return rr.EncodedImage.columns(blob=list(values), media_type=["image/jpeg"] * len(values))


def circles(values: Sequence[tuple[Array, float]]) -> Any:
    """Columns of circles in the image: centres (n, 2) px and one radius px."""
    lengths = [len(centres) for centres, _ in values]
    radii = [(radius, radius) for centres, radius in values for _ in centres]
    return [
        *rr.Ellipses2D.columns(centers=np.concatenate([c for c, _ in values])).partition(lengths),
        *rr.Ellipses2D.columns(half_sizes=np.array(radii, dtype=float).reshape(-1, 2)).partition(lengths),
    ]


def lines_2d(values: Sequence[Array]) -> Any:
    """Columns of one line in the image each, (n, 2) px; n = 0 removes the last one."""
    return _lines(rr.LineStrips2D, values)


def lines_3d(values: Sequence[Array]) -> Any:
    """Columns of one line in space each, (n, 3) m; n = 0 removes the last one."""
    return _lines(rr.LineStrips3D, values)


def _lines(archetype: Any, values: Sequence[Array]) -> Any:
    columns = archetype.columns(strips=[v for v in values if len(v)])
    return columns.partition([int(len(v) > 0) for v in values])


def colours_2d(values: Sequence[tuple[int, ...]]) -> Any:
    """Columns of the colour of one line in the image each."""
    return rr.LineStrips2D.columns(colors=np.array(values, dtype=np.uint8))


def states(values: Sequence[str]) -> Any:
    """Columns of named states."""
    return rr.StateChange.columns(state=list(values))


def ellipsoids(values: Sequence[ArrayLike]) -> Any:
    """Columns of one ellipsoid each, by its half axes (3,) m."""
    return rr.Ellipsoids3D.columns(half_sizes=np.array(values, dtype=float))


def texts(values: Sequence[str]) -> Any:
    """Columns of Markdown documents."""
    return rr.TextDocument.columns(text=list(values), media_type=["text/markdown"] * len(values))


def tags(values: Sequence[tuple[ArrayLike, tuple[int, ...], str]]) -> Any:
    """Columns of one labelled point in space each: position (3,) m, colour, text."""
    return rr.Points3D.columns(
        positions=np.array([position for position, _, _ in values], dtype=float),
        colors=np.array([colour for _, colour, _ in values], dtype=np.uint8),
        labels=[text for _, _, text in values],
    )


def no_tags(values: Sequence[None]) -> Any:
    """Columns that remove the last tag."""
    return rr.Points3D.columns(positions=np.zeros((0, 3))).partition([0] * len(values))


class Columns:
    """Rows by entity, in the order they came."""

    def __init__(self) -> None:
        self._rows: dict[tuple[Kind, str], list[tuple[int, Any]]] = {}

    def add(self, kind: Kind, entity: str, t_ns: int, value: Any) -> None:
        """Add one row of an entity, valid at t_ns."""
        self._rows.setdefault((kind, entity), []).append((t_ns, value))

    def flush(self, stream: "rr.RecordingStream", *, plots: bool = True) -> None:
        """Send all rows to the stream; without `plots`, time series wait for a later call."""
        kept = {} if plots else {key: rows for key, rows in self._rows.items() if key[0] is scalars}
        for (kind, entity), rows in self._rows.items():
            if (kind, entity) in kept:
                continue
            times = np.array([t for t, _ in rows], dtype="timedelta64[ns]")
            stream.send_columns(
                entity, indexes=[rr.TimeColumn(TIMELINE, duration=times)], columns=kind([v for _, v in rows])
            )
        self._rows = kept

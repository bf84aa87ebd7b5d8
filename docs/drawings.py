"""The drawings of the documents as SVG: the geometry, the flow, and the parts of the code.

    python docs/drawings.py

writes them into docs/pictures. The geometry is projected with the code's own camera and rotations, the parts
follow from the imports. Colours have medium brightness on no background, so that they are legible in light and
dark.
"""

import math
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import Any, Final

import numpy as np

from onboard.geometry.camera import make_camera, project
from onboard.geometry.rotations import matrix_from_euler

PICTURES: Final = Path(__file__).parent / "pictures"
INK, FAINT = "#73808d", "#9aa5b1"
BLUE, ORANGE, PINK, GREEN = "#3a90d8", "#d07a1f", "#d0458c", "#2a9a5b"
FONT_SIZE: Final = 17

Point = Sequence[float]


class Drawing:
    """An SVG that grows; x to the right and y down, px."""

    def __init__(self, width: int, height: int, title: str) -> None:
        self._size, self._title = (width, height), title
        self._parts: list[str] = []

    def line(
        self, points: Iterable[Point], colour: str, width: float = 1.5, *, dash: str = "", arrow: bool = False
    ) -> None:
        """Draw a line through points (n, 2), with an arrow at its end on request."""
        at = [(float(x), float(y)) for x, y in points]
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in at)
        dashed = f' stroke-dasharray="{dash}"' if dash else ""
        self._parts.append(
            f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="{width}"{dashed}/>'
        )
        if arrow:
            self._head(at[-2], at[-1], colour)

    def shape(self, points: Iterable[Point], colour: str, opacity: float = 0.25) -> None:
        """Draw a filled polygon with its outline."""
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        style = f'fill="{colour}" fill-opacity="{opacity}" stroke="{colour}"'
        self._parts.append(f'<polygon points="{path}" {style}/>')

    def dot(self, at: Point, colour: str, radius: float = 3.5) -> None:
        """Draw a point."""
        self._parts.append(f'<circle cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="{radius}" fill="{colour}"/>')

    def text(
        self,
        at: Point,
        words: str,
        colour: str = INK,
        *,
        anchor: str = "start",
        size: int = FONT_SIZE,
        bold: bool = False,
    ) -> None:
        """Draw a line of text that begins (`start`), is centred (`middle`) or ends (`end`) at a point."""
        weight = ' font-weight="600"' if bold else ""
        place = f'x="{at[0]:.1f}" y="{at[1]:.1f}" text-anchor="{anchor}"'
        self._parts.append(f'<text {place} font-size="{size}" fill="{colour}"{weight}>{escape(words)}</text>')

    def box(self, x: float, y: float, w: float, h: float, words: Sequence[str], colour: str) -> None:
        """Draw a box with lines of text, the first in bold."""
        style = f'fill="{colour}" fill-opacity="0.12" stroke="{colour}" stroke-width="1.3"'
        self._parts.append(f'<rect x="{x:.1f}" y="{y:.1f}" width="{w:.1f}" height="{h:.1f}" rx="6" {style}/>')
        top = y + h / 2 - (len(words) - 1) * 9 + 5
        for k, line in enumerate(words):
            self.text(
                (x + w / 2, top + 18 * k),
                line,
                colour if k == 0 else INK,
                anchor="middle",
                bold=k == 0,
                size=FONT_SIZE - 3 * (k > 0),
            )

    def save(self, name: str) -> str:
        """Write the drawing into docs/pictures, and return its text."""
        w, h = self._size
        space = 'xmlns="http://www.w3.org/2000/svg" font-family="sans-serif" role="img"'
        head = f'<svg {space} viewBox="0 0 {w} {h}" width="{w}">'
        text = "\n".join([head, f"<title>{escape(self._title)}</title>", *self._parts, "</svg>", ""])
        PICTURES.mkdir(exist_ok=True)
        (PICTURES / name).write_text(text, encoding="utf-8")
        return text

    def _head(self, before: Point, end: Point, colour: str) -> None:
        angle = math.atan2(end[1] - before[1], end[0] - before[0])
        sides = [(end[0] - 9 * math.cos(angle + s), end[1] - 9 * math.sin(angle + s)) for s in (-0.4, 0.4)]
        self.shape([end, *sides], colour, 1.0)


class Eye:
    """A perspective from a point in NED (3,) m towards another."""

    def __init__(self, position: Point, target: Point, focal: float, middle: Point) -> None:
        self._position, self._focal, self._middle = np.array(position), focal, np.array(middle)
        forward = np.array(target) - self._position
        forward = forward / np.linalg.norm(forward)
        right = np.cross([0.0, 0.0, 1.0], forward)
        right = right / np.linalg.norm(right)
        self._axes = np.array([right, np.cross(forward, right), forward])

    def see(self, points: Any) -> Any:
        """Project points (n, 3) in NED to pixels (n, 2)."""
        seen = (np.atleast_2d(points) - self._position) @ self._axes.T
        return self._middle + self._focal * seen[:, :2] / seen[:, 2:]


def geometry() -> Drawing:
    """Draw vehicle, camera, image, leader and the frames, from behind."""
    drawing = Drawing(980, 560, "The frames: origin, vehicle, camera with its image, and the leader")
    eye = Eye((-21.0, 19.0, -24.0), (8.0, 0.5, -5.5), 860.0, (560.0, 270.0))
    origin, own, leader = np.array([-3.0, -8.0, 0.0]), np.array([0.0, 1.5, -6.5]), np.array([22.0, 4.0, -8.5])
    R_nb, R_nl = matrix_from_euler(0.12, 0.05, 0.18), matrix_from_euler(-0.25, 0.03, 0.05)
    camera = make_camera(f_px=554.0, width_px=640.0, height_px=480.0, mount_offset=(1.2, 0.0, 0.2))
    lens = own + R_nb @ camera.r_FC_b
    ground(drawing, eye)
    axes(drawing, eye, origin, np.diag([4.5, 4.5, 2.6]), ("north", "east", "down"), INK)
    drawing.text(eye.see(origin)[0] + (-14, 20), "O", INK, bold=True, anchor="end")
    aircraft(drawing, eye, own, R_nb, 3.2, ORANGE)
    axes(drawing, eye, own, R_nb * 3.6, ("x_b", "y_b", "z_b"), ORANGE)
    aircraft(drawing, eye, leader, R_nl, 5.4, BLUE)
    vector(drawing, eye, origin, own, "r_OF_n", INK, (14, 24))
    vector(drawing, eye, own, leader, "r_FL_n", PINK, (-6, -14))
    drawing.text(eye.see(own)[0] + (-20, 22), "F", ORANGE, bold=True, anchor="end")
    drawing.text(eye.see(leader)[0] + (4, -32), "L, the leader", BLUE, bold=True, anchor="middle")
    tips = np.array([[0.0, 0.0, 0.0], [0.0, -2.7, 0.0], [0.0, 2.7, 0.0]]) @ R_nl.T + leader
    image(drawing, eye, lens, R_nb @ camera.R_bc, camera, tips)
    notes = (
        (INK, "n: north, east, down; its origin O is the autopilot's"),
        (ORANGE, "b: our body at F: forward, right, down"),
        (GREEN, "c: the camera; points (Y_c/X_c, Z_c/X_c) of an image at unit distance"),
        (BLUE, "the leader's center and wingtips; size: its wingspan"),
        (PINK, "what is estimated: r_FL_n, its velocity, the size"),
    )
    for k, (colour, words) in enumerate(notes):
        drawing.text((20, 32 + 23 * k), words, colour, size=16)
    return drawing


def ground(drawing: Drawing, eye: Eye) -> None:
    """Draw a grid at the origin's height."""
    for k in range(-10, 26, 5):
        drawing.line(eye.see([[k, -12.0, 0.0], [k, 8.0, 0.0]]), FAINT, 0.6)
    for k in range(-12, 10, 4):
        drawing.line(eye.see([[-10.0, k, 0.0], [25.0, k, 0.0]]), FAINT, 0.6)


def axes(drawing: Drawing, eye: Eye, at: Any, columns: Any, names: Sequence[str], colour: str) -> None:
    """Draw three axes (3, 3), in columns, from a point."""
    for k, name in enumerate(names):
        start, end = eye.see([at, at + columns[:, k]])
        drawing.line([start, end], colour, 1.8, arrow=True)
        drawing.text(end + 9 * (end - start) / np.linalg.norm(end - start) + (0, 5), name, colour, size=15)


def vector(drawing: Drawing, eye: Eye, start: Any, end: Any, name: str, colour: str, shift: Point) -> None:
    """Draw a vector with its name at its middle."""
    a, b = eye.see([start, end])
    drawing.line([a, b], colour, 2.0, dash="7 4", arrow=True)
    drawing.text((a + b) / 2 + np.array(shift), name, colour, bold=True)


def aircraft(drawing: Drawing, eye: Eye, at: Any, R: Any, span: float, colour: str) -> None:
    """Draw an aircraft of a wingspan (m): wing, body and tail."""
    half, chord = span / 2, 0.16 * span
    outlines = (
        [(chord, -half, 0), (chord, half, 0), (-chord, half, 0), (-chord, -half, 0)],
        [(0.45 * span, 0, 0), (0.2 * span, 0.06 * span, 0), (-0.55 * span, 0, 0), (0.2 * span, -0.06 * span, 0)],
        [
            (-0.42 * span, -0.2 * span, 0),
            (-0.42 * span, 0.2 * span, 0),
            (-0.58 * span, 0.2 * span, 0),
            (-0.58 * span, -0.2 * span, 0),
        ],
    )
    for outline in outlines:
        drawing.shape(eye.see(np.array(outline) @ R.T + at), colour)


def image(drawing: Drawing, eye: Eye, lens: Any, R_nc: Any, camera: Any, seen: Any) -> None:
    """Draw the camera's image some metres in front of it, and the rays to the points."""
    distance = 6.0
    half = np.array([camera.width_px, camera.height_px]) / (2 * camera.f_px)
    corners = np.array([(1, sx * half[0], sy * half[1]) for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
    drawing.shape(eye.see(distance * corners @ R_nc.T + lens), GREEN, 0.1)
    for corner in corners:
        drawing.line(eye.see([lens, lens + distance * R_nc @ corner]), GREEN, 0.6)
    points = project((seen - lens) @ R_nc)
    on_plane = distance * np.column_stack([np.ones(3), points]) @ R_nc.T + lens
    for target, point in zip(seen, on_plane, strict=True):
        drawing.line(eye.see([lens, target]), BLUE, 0.7, dash="3 4")
        drawing.dot(eye.see(point)[0], GREEN)
    drawing.line(eye.see(on_plane[[1, 0, 2]]), GREEN, 2.0)
    drawing.dot(eye.see(lens)[0], GREEN, 3.0)
    drawing.text(eye.see(lens)[0] + (8, 20), "C", GREEN, bold=True)
    top = eye.see(distance * corners[1] @ R_nc.T + lens)[0]
    drawing.text(top + np.array([6, 14]), "the image", GREEN)


FLOW: Final = (
    ("links", "UDP, TCP, serial, Zenoh, files", "bytes with their arrival"),
    ("wire", "MAVLink, JSON, ROS, signing", "messages in SI units"),
    ("clocks", "TIMESYNC, arrivals, reboots", "one time base: when it was true"),
    ("ownship", "interpolation, contradictions", "our own pose at any time"),
    ("estimators", "rewind if late, predict, gate, update", "estimates with covariance"),
)
ENDS: Final = (
    ("sinks", "Zenoh, recorder"),
    ("autopilot", "the leader, traffic, odometry"),
    ("health", "advice, consistency"),
)


def flow() -> Drawing:
    """Draw the way from bytes to estimates; each arrow is one function call."""
    drawing = Drawing(980, 330, "The flow: from bytes on a link to what is published")
    w, h, gap = 156, 84, 40
    for k, (name, inside, outcome) in enumerate(FLOW):
        x = 12 + k * (w + gap)
        words = [name, *_wrapped(inside, 19)]
        drawing.box(x, 60, w, h, words, ORANGE if k == 0 else BLUE)
        for i, line in enumerate(_wrapped(outcome, 19)):
            drawing.text((x + w / 2, 166 + 17 * i), line, GREEN, anchor="middle", size=14)
        if k:
            drawing.line([(x - gap + 3, 102), (x - 3, 102)], INK, 1.6, arrow=True)
    drawing.text((12, 40), "asyncio", ORANGE, bold=True)
    drawing.line([(12 + w + gap, 46), (968, 46)], BLUE, 1.0)
    drawing.text((12 + w + gap, 38), "synchronous and deterministic: Pipeline.feed(datagram)", BLUE, bold=True)
    last = 12 + 4 * (w + gap) + w / 2
    drawing.line([(last, 200), (last, 222), (150, 222)], INK, 1.6)
    for k, (name, inside) in enumerate(ENDS):
        x = 40 + 300 * k
        drawing.line([(x + 110, 222), (x + 110, 244)], INK, 1.6, arrow=True)
        drawing.box(x, 247, 220, 62, [name, inside], ORANGE)
    return drawing


def _wrapped(words: str, width: int) -> list[str]:
    lines = [""]
    for word in words.split():
        if lines[-1] and len(lines[-1]) + len(word) + 1 > width:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    return lines


def house(floors: Sequence[set[str]], arrows: Iterable[tuple[str, str]]) -> Drawing:
    """Draw the parts of `onboard` on their floors, with the imports between them."""
    drawing = Drawing(980, 64 * len(floors) + 20, "The house: parts of the code on their floors, imports go down")
    at: dict[str, tuple[float, float]] = {}
    for k, floor in enumerate(reversed(floors)):
        names, y = sorted(floor), 14.0 + 64 * k
        step = min(960 / len(names), 420 if k % 2 else 300)  # so that lines pass beside boxes
        for i, name in enumerate(names):
            at[name] = 490 + step * (i - (len(names) - 1) / 2), y
    direct = {tuple(name.removeprefix("onboard.") for name in pair) for pair in arrows}
    for above, below in sorted(essential({(a, b) for a, b in direct if a in at and b in at})):
        (x0, y0), (x1, y1) = at[above], at[below]
        drawing.line([(x0, y0 + 34), (x1, y1 - 3)], INK, 1.1, arrow=True)
    for name, (x, y) in at.items():
        colour = ORANGE if name in ("links", "sinks", "daemon", "commands", "view", "__main__") else BLUE
        drawing.box(x - 58, y, 116, 34, [name], colour)
    return drawing


def essential(arrows: set[tuple[str, str]]) -> set[tuple[str, str]]:
    """Return the arrows that no path over other parts replaces."""
    below: dict[str, set[str]] = {}
    for a, b in arrows:
        below.setdefault(a, set()).add(b)

    def reached(start: str) -> set[str]:
        found = set(below.get(start, ()))
        for part in tuple(found):
            found |= reached(part)
        return found

    return {(a, b) for a, b in arrows if not any(b in reached(other) for other in below[a] - {b})}


def main() -> None:
    """Write all three."""
    import sys  # noqa: PLC0415

    sys.path.insert(0, str(Path(__file__).parents[1]))
    from tests.unit.house import test_import_rules as rules  # noqa: PLC0415

    geometry().save("geometry.svg")
    flow().save("flow.svg")
    house(rules.FLOORS, rules.drawing(rules.ROOT)[1]).save("house.svg")


if __name__ == "__main__":
    main()

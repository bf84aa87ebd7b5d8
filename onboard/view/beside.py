"""Other estimators of the leader, each as a curve in the plots and an outline in the scene.

Their bands are not drawn, since one very wide band would flatten every plot.
"""

from typing import Final

import numpy as np

from onboard.messages import Estimate
from onboard.view import palette, plots, scene, shapes, space
from onboard.view.columns import HIDDEN, Columns, Transform, no_tags, scalars, tags, transforms
from onboard.view.memory import DRAW_RATE_HZ, Memory
from onboard.view.motion import LeaderArrays
from onboard.view.sdk import rr

BESIDE_PLOTS: Final = ("range", *plots.QUANTITIES.values())


def colour_of(place: int) -> tuple[str, palette.Colour]:
    """Return the colour, with its name, of the estimator at this place among the others."""
    colours = tuple(palette.BESIDE_COLOURS.items())
    return colours[place % len(colours)]


def log_static(stream: "rr.RecordingStream", name: str, colour: palette.Colour) -> None:
    """Log the curves, outline and label of an estimator, which do not change."""
    for plot in (*BESIDE_PLOTS, *plots.ERROR_PLOTS):
        scene.log_curves(stream, f"plots/{plot}/{name}", [(name, colour, 1.5)])
    scene.log_lines(stream, f"{scene.BESIDE_PATH}/{name}/outline", shapes.aeroplane_outline(), colour, 0.8)
    stream.log(f"{scene.BESIDE_PATH}/{name}", rr.TransformAxes3D(axis_length=0.0), static=True)
    label = rr.Points3D.from_fields(radii=0.0, show_labels=True)
    stream.log(f"{scene.BESIDE_TAG}/{name}", label, static=True)


def draw(
    columns: Columns, memory: Memory, estimate: Estimate, leader: LeaderArrays | None, colour: palette.Colour
) -> None:
    """Draw the range and components of an estimate.

    Its error follows with the truth (`plots.plot_errors`).
    """
    name, t_ns = estimate.name, estimate.t_ns
    outline, label = f"{scene.BESIDE_PATH}/{name}", f"{scene.BESIDE_TAG}/{name}"
    if leader is None:
        for plot in BESIDE_PLOTS:
            columns.add(scalars, f"plots/{plot}/{name}", t_ns, np.nan)
        columns.add(transforms, outline, t_ns, HIDDEN)
        columns.add(no_tags, label, t_ns, None)
        return
    columns.add(scalars, f"plots/range/{name}", t_ns, float(np.linalg.norm(leader.r)))
    for k, plot in plots.QUANTITIES.items():
        columns.add(scalars, f"plots/{plot}/{name}", t_ns, leader.mean[k])
    memory.waiting[name].append(leader)
    if not memory.is_due(f"beside {name}", t_ns, DRAW_RATE_HZ):
        return
    v_F_n = np.zeros(3) if memory.own is None else np.asarray(memory.own.v_F_n, dtype=float)
    attitude = space.leader_attitude(memory, t_ns, v_F_n + leader.mean[3:6])
    span = leader.mean[6] if np.isfinite(leader.mean[6]) else 1.0
    columns.add(transforms, outline, t_ns, Transform(leader.r, attitude, np.full(3, span)))
    below = leader.r + np.array([0.0, 0.0, space.TAG_OFFSET])
    columns.add(tags, label, t_ns, (below, colour, name))

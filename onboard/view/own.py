"""Our own state: its time series and headline, and our rotors with their faults.

The plots contain the autopilot's estimate and, in a simulation, the truth.
"""

import numpy as np

from onboard.geometry.rotations import euler_from_quaternion, quaternion_product, vector_from_quaternion
from onboard.messages import FaultKind, NavState, OwnPose, Truth
from onboard.messages.between import nav_state_at
from onboard.view import palette, scene, words
from onboard.view.columns import (
    HIDDEN,
    UNROTATED_WXYZ,
    Columns,
    ImagePoints,
    Transform,
    colours_2d,
    discs,
    labels,
    no_tags,
    scalars,
    tags,
    transforms,
)
from onboard.view.memory import DRAW_RATE_HZ, STATUS_RATE_HZ, Memory
from onboard.view.plots import GAP, banded
from onboard.view.plots import plot_state as plot_strip

ANGLE_NAMES = scene.OWN_NAMES[3:6]
ERRORS = ("velocity_error", "attitude_error")
LABEL_OFFSET = 0.75  # spans below the centre of the rotors' panel
UNDISTURBED = Transform((0.0, 0.0, 0.0), UNROTATED_WXYZ, (1.0, 1.0, 1.0))


def show_state(columns: Columns, memory: Memory, state: NavState, rotors: scene.Rotors) -> None:
    """Apply all changes of the view for one own state."""
    plot_state(columns, memory, state)
    last_ns = memory.own_states[-1].t_ns if memory.own_states else state.t_ns
    memory.own_states.append(state)
    for truth in memory.truths:
        if last_ns < truth.t_ns <= state.t_ns:
            plot_error(columns, memory, truth)
    by_weight = sorted(state.faults, key=lambda f: f.kind is FaultKind.GUST)  # a gust passes
    named = [str(f.part or f.kind) for f in by_weight]
    plot_strip(columns, memory, "own_state", state.t_ns, state.state)
    plot_strip(columns, memory, "faults", state.t_ns, next(iter(named), palette.NO_FAULT))
    if memory.is_due("own words", state.t_ns, STATUS_RATE_HZ):
        draw_words(columns, state)
        draw_rotors(columns, state, rotors)


def draw_words(columns: Columns, state: NavState) -> None:
    """Draw the headline, red if we have a fault, and the same label at our vehicle."""
    t_ns, wrong = state.t_ns, ", ".join(map(words.fault, state.faults))
    colour = palette.RED if wrong else palette.STATES[state.state]
    line = words.own_headline(state)
    columns.add(labels, f"{scene.OWN_BANNER}/words", t_ns, ImagePoints(np.zeros((1, 2)), colour, line))
    columns.add(colours_2d, f"{scene.OWN_BANNER}/bar", t_ns, palette.shade(colour, 0.35))
    below = ImagePoints(np.array([[0.0, LABEL_OFFSET]]), colour, words.plain(wrong or palette.NO_FAULT))
    columns.add(labels, f"{scene.ROTORS_PATH}/words", t_ns, below)
    if wrong:
        columns.add(tags, scene.OWN_TAG, t_ns, (np.array([0.0, 0.0, 1.2]), colour, words.plain(wrong)))
    else:
        columns.add(no_tags, scene.OWN_TAG, t_ns, None)


def draw_rotors(columns: Columns, state: NavState, rotors: scene.Rotors) -> None:
    """Draw each rotor in the colour of its health, with its loss of thrust."""
    if not rotors:
        return
    lost = {f.part: f.magnitude for f in state.faults if f.kind is FaultKind.MOTOR}
    names = [f"motor {k + 1}" for k in range(len(rotors))]
    well = palette.GREEN if state.valid else palette.GREY
    colours = [palette.RED if name in lost else well for name in names]
    text = [f"{name}: -{lost[name]:.0%}" if name in lost else name for name in names]
    columns.add(discs, f"{scene.ROTORS_PATH}/discs", state.t_ns, (colours, text))
    for k, name in enumerate(names):
        columns.add(transforms, f"{scene.WEAK}/{k}", state.t_ns, UNDISTURBED if name in lost else HIDDEN)


def plot_error(columns: Columns, memory: Memory, truth: Truth) -> None:
    """Plot the errors of velocity (m/s) and attitude (degrees, about b's axes) at the time of a truth."""
    state = nav_state_at(list(memory.own_states), truth.t_ns)
    if state is None or state.mean is None or state.q_nb is None:
        return
    columns.add(scalars, "plots/own/velocity_error/error", truth.t_ns, np.subtract(state.mean[3:6], truth.v_F_n))
    turn = vector_from_quaternion(quaternion_product(np.multiply(truth.q_nF, (1, -1, -1, -1)), state.q_nb))
    columns.add(scalars, "plots/own/attitude_error/error", truth.t_ns, np.degrees(turn))


def plot_state(columns: Columns, memory: Memory, state: NavState) -> None:
    """Plot velocity, attitude (degrees), height, model error and quality, with their bands."""
    t_ns = state.t_ns
    if not memory.is_due("own state", t_ns, DRAW_RATE_HZ):
        return
    shares = [100 * (state.switch_fraction or 0.0), float(state.quality)]
    columns.add(scalars, "plots/own/trust", t_ns, np.array(shares))
    if state.mean is None or state.covariance is None:
        for name in scene.OWN_NAMES:
            columns.add(scalars, f"plots/own/{name}/estimate", t_ns, GAP)
        for name in ERRORS:
            columns.add(scalars, f"plots/own/{name}/band", t_ns, GAP[:2])
        return
    mean, sigma = np.array(state.mean), np.sqrt(np.maximum(np.diag(np.array(state.covariance)), 0.0))
    for k, name in enumerate(scene.AXIS_NAMES):
        columns.add(scalars, f"plots/own/{name}/estimate", t_ns, banded(mean[3 + k], sigma[3 + k]))
    for k, name in enumerate(ANGLE_NAMES):
        degrees = np.degrees([mean[6 + k], sigma[6 + k]])
        columns.add(scalars, f"plots/own/{name}/estimate", t_ns, banded(*degrees))
    columns.add(scalars, "plots/own/height/estimate", t_ns, banded(-mean[2], sigma[2]))
    for name, widest in zip(ERRORS, (sigma[3:6].max(), np.degrees(sigma[6:9].max())), strict=True):
        columns.add(scalars, f"plots/own/{name}/band", t_ns, banded(0.0, widest)[1:])


def plot_autopilot(columns: Columns, memory: Memory, pose: OwnPose) -> None:
    """Plot the autopilot's estimate of the same quantities, once there is one of ours."""
    if "own state" in memory.drawn_ns and memory.is_due("own autopilot", pose.t_ns, DRAW_RATE_HZ):
        _add(columns, "autopilot", pose.t_ns, pose.v_F_n, pose.q_nb, pose.r_OF_n[2])


def plot_truth(columns: Columns, memory: Memory, truth: Truth) -> None:
    """Plot the truth of the same quantities, and the errors of the state at that time."""
    if "own state" in memory.drawn_ns:
        _add(columns, "truth", truth.t_ns, truth.v_F_n, truth.q_nF, truth.r_OF_n[2])
        if memory.own_states and truth.t_ns <= memory.own_states[-1].t_ns:
            plot_error(columns, memory, truth)  # otherwise with the state that comes next


def _add(
    columns: Columns, who: str, t_ns: int, v_n: tuple[float, ...], q_nb: tuple[float, ...], down: float
) -> None:
    if not (np.isfinite([*v_n, *q_nb, down]).all() and np.any(q_nb)):
        return
    for name, value in zip(scene.AXIS_NAMES, v_n, strict=True):
        columns.add(scalars, f"plots/own/{name}/{who}", t_ns, float(value))
    for name, angle in zip(ANGLE_NAMES, euler_from_quaternion(q_nb), strict=True):
        columns.add(scalars, f"plots/own/{name}/{who}", t_ns, float(np.degrees(angle)))
    columns.add(scalars, f"plots/own/height/{who}", t_ns, -down)

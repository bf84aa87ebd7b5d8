"""Our own state into time series, beside the autopilot's estimate and, in a simulation, the truth."""

import numpy as np

from onboard.geometry.rotations import euler_from_quaternion
from onboard.messages import NavState, OwnPose, Truth
from onboard.view import scene
from onboard.view.columns import Columns, scalars
from onboard.view.memory import Memory
from onboard.view.plots import GAP, banded

PLOT_HZ = 25.0
ANGLES = scene.OWN_NAMES[3:6]


def plot_state(columns: Columns, memory: Memory, state: NavState) -> None:
    """Velocity, attitude (degrees) and height with their bands; the share outside the boundary layer; quality."""
    t_ns = state.t_ns
    if not memory.due("own state", t_ns, PLOT_HZ):
        return
    shares = [100 * (state.switch_fraction or 0.0), float(state.quality)]
    columns.add(scalars, "plots/own/trust", t_ns, np.array(shares))
    if state.mean is None or state.covariance is None:
        for name in scene.OWN_NAMES:
            columns.add(scalars, f"plots/own/{name}/estimate", t_ns, GAP)
        return
    mean, sigma = np.array(state.mean), np.sqrt(np.maximum(np.diag(np.array(state.covariance)), 0.0))
    for k, name in enumerate(scene.AXIS_NAMES):
        columns.add(scalars, f"plots/own/{name}/estimate", t_ns, banded(mean[3 + k], sigma[3 + k]))
    for k, name in enumerate(ANGLES):
        degrees = np.degrees([mean[6 + k], sigma[6 + k]])
        columns.add(scalars, f"plots/own/{name}/estimate", t_ns, banded(*degrees))
    columns.add(scalars, "plots/own/height/estimate", t_ns, banded(-mean[2], sigma[2]))


def plot_autopilot(columns: Columns, memory: Memory, pose: OwnPose) -> None:
    """The autopilot's estimate of the same quantities, once there is one of ours."""
    if "own state" in memory.drawn_ns and memory.due("own autopilot", pose.t_ns, PLOT_HZ):
        _add(columns, "autopilot", pose.t_ns, pose.v_F_n, pose.q_nb, pose.r_OF_n[2])


def plot_truth(columns: Columns, memory: Memory, truth: Truth) -> None:
    """The truth of the same quantities."""
    if "own state" in memory.drawn_ns:
        _add(columns, "truth", truth.t_ns, truth.v_F_n, truth.q_nF, truth.r_OF_n[2])


def _add(
    columns: Columns, who: str, t_ns: int, v_n: tuple[float, ...], q_nb: tuple[float, ...], down: float
) -> None:
    if not (np.isfinite([*v_n, *q_nb, down]).all() and np.any(q_nb)):
        return
    for name, value in zip(scene.AXIS_NAMES, v_n, strict=True):
        columns.add(scalars, f"plots/own/{name}/{who}", t_ns, float(value))
    for name, angle in zip(ANGLES, euler_from_quaternion(q_nb), strict=True):
        columns.add(scalars, f"plots/own/{name}/{who}", t_ns, float(np.degrees(angle)))
    columns.add(scalars, f"plots/own/height/{who}", t_ns, -down)

"""Drawing of records as time series."""

import numpy as np

from onboard.arrays import Array
from onboard.messages import Estimate, Health, MeasurementReport, Truth
from onboard.view import palette, scene
from onboard.view.columns import Columns, scalars, states
from onboard.view.memory import Memory
from onboard.view.motion import LeaderArrays, range_estimate, truth_at, truth_vector
from onboard.view.sdk import rr
from onboard.view.words import plain

# where each component is drawn, by its place in motion.COMPONENTS
QUANTITIES = {
    3: "velocity/north",
    4: "velocity/east",
    5: "velocity/down",
    6: "size",
    7: "acceleration/lateral",
    8: "acceleration/longitudinal",
}
ERROR_PLOTS = ("range_error", *(f"error/{axis}" for axis in scene.AXIS_NAMES))
NIS_CLIP = 3.0
GAP = np.full(3, np.nan)  # of a curve and its band
OUR_ESTIMATOR = ""  # the view's own estimator, among those waiting for a truth


def banded(value: float, sigma: float) -> Array:
    """Return a value and the edges of its band, (3,)."""
    return np.array([value, value + scene.DRAWN_SIGMAS * sigma, value - scene.DRAWN_SIGMAS * sigma])


def plot_leader(columns: Columns, memory: Memory, t_ns: int, leader: LeaderArrays | None) -> None:
    """Plot range and components with their bands; gaps without a state."""
    if leader is None:
        for name in ("range", *QUANTITIES.values()):
            columns.add(scalars, f"plots/{name}/estimate", t_ns, GAP)
        return
    r = range_estimate(leader)
    columns.add(scalars, "plots/range/estimate", t_ns, banded(r.range, r.sigma))
    for k, name in QUANTITIES.items():
        columns.add(scalars, f"plots/{name}/estimate", t_ns, banded(leader.mean[k], leader.sigma[k]))
    memory.waiting[OUR_ESTIMATOR].append(leader)


def plot_truth(columns: Columns, truth: Truth) -> None:
    """Plot the true values of the same quantities."""
    values = truth_vector(truth)
    columns.add(scalars, "plots/range/truth", truth.t_ns, float(np.linalg.norm(values[:3])))
    for k, name in QUANTITIES.items():
        columns.add(scalars, f"plots/{name}/truth", truth.t_ns, values[k])


def plot_errors(columns: Columns, memory: Memory) -> None:
    """Plot the errors of waiting states once the truth has reached their time."""
    newest = memory.truths[-1].t_ns if memory.truths else None
    for name, waiting in memory.waiting.items():
        while waiting and newest is not None and waiting[0].t_ns <= newest:
            leader = waiting.popleft()
            truth = truth_at(memory.truths, leader.t_ns)
            if truth is None:
                continue
            if name == OUR_ESTIMATOR:
                memory.error = float(np.linalg.norm(leader.r - truth[:3]))
            _plot_error(columns, name, leader, truth[:3])


def _plot_error(columns: Columns, name: str, leader: LeaderArrays, r: Array) -> None:
    """Plot the error of a state with the true position `r` (3,) m; only ours has a band."""
    ours = range_estimate(leader)
    errors = [ours.range - float(np.linalg.norm(r)), *(leader.r - r)]
    for plot, error, sigma in zip(ERROR_PLOTS, errors, (ours.sigma, *leader.sigma[:3]), strict=True):
        edge = scene.DRAWN_SIGMAS * sigma
        if name == OUR_ESTIMATOR:
            columns.add(scalars, f"plots/{plot}", leader.t_ns, np.array([error, edge, -edge]))
        else:
            columns.add(scalars, f"plots/{plot}/{name}", leader.t_ns, error)


def plot_report(columns: Columns, memory: Memory, report: MeasurementReport, stream: "rr.RecordingStream") -> None:
    """Plot innovations in sigmas with gates at three, and the NIS as a share of its gate."""
    t_ns = report.t_ns
    if report.innovation is not None and report.innovation_sigma is not None:
        sigma = np.asarray(report.innovation_sigma, dtype=float)
        ratio = np.asarray(report.innovation, dtype=float) / np.where(sigma > 0, sigma, np.nan)
        if memory.innovations != len(ratio):
            names = report.components or tuple(str(k) for k in range(len(ratio)))
            colours = [palette.AXIS_RGB[k % 3] for k in range(len(ratio))]
            scene.log_curves(
                stream, "plots/innovation/value", [(plain(n), c, 1.3) for n, c in zip(names, colours, strict=True)]
            )
            memory.innovations = len(ratio)
        columns.add(scalars, "plots/innovation/value", t_ns, ratio)
        columns.add(scalars, "plots/innovation/gate", t_ns, np.array([scene.DRAWN_SIGMAS, -scene.DRAWN_SIGMAS]))
    if report.nis is not None and report.gate is not None:
        # one outlier must not flatten the plot: values far beyond the gate are drawn at its upper edge
        columns.add(scalars, "plots/nis/value", t_ns, np.minimum(report.nis / max(report.gate, 1e-9), NIS_CLIP))
        columns.add(scalars, "plots/nis/gate", t_ns, 1.0)


def plot_health(columns: Columns, memory: Memory, health: Health, stream: "rr.RecordingStream") -> None:
    """Plot the rate of every stream, Hz."""
    for name, one in health.streams.items():
        columns.add(scalars, _line(memory, stream, "rate", name), health.t_ns, one.rate)


def plot_consistency(columns: Columns, memory: Memory, health: Health, stream: "rr.RecordingStream") -> None:
    """Plot the mean NIS of each source over its expectation, and the bounds of the last."""
    for name, one in health.consistency.items():
        columns.add(scalars, _line(memory, stream, "consistency", name), health.t_ns, one.nis)
        columns.add(scalars, "plots/consistency/bounds", health.t_ns, np.array([one.low, one.high]))


def plot_state(columns: Columns, memory: Memory, strip: str, t_ns: int, state: str) -> None:
    """Add a new state to a strip if it has changed."""
    if memory.shown.get(strip) != state:
        memory.shown[strip] = state
        columns.add(states, strip, t_ns, state)


def plot_no_image(columns: Columns, memory: Memory, t_ns: int) -> None:
    """Plot a gap in the innovations while there are no images."""
    if memory.innovations and memory.is_due("no innovation", t_ns, 2.0):
        columns.add(scalars, "plots/innovation/value", t_ns, np.full(memory.innovations, np.nan))


def plot_age(columns: Columns, estimate: Estimate) -> None:
    """Plot the age of the last fused image, s."""
    age = estimate.age
    columns.add(scalars, "plots/age", estimate.t_ns, np.nan if age is None else age)


def _line(memory: Memory, stream: "rr.RecordingStream", plot: str, name: str) -> str:
    """Return the entity of a curve, and set its style when it is first drawn."""
    entity = f"plots/{plot}/{rr.escape_entity_path_part(name)}"
    if entity not in memory.rates:
        stream.log(entity, rr.SeriesLines(names=plain(name), widths=1.5), static=True)
        memory.rates.add(entity)
    return entity

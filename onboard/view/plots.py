"""Records into time series."""

import numpy as np

from onboard.arrays import Array
from onboard.messages import Estimate, Health, MeasurementReport, Truth
from onboard.view import palette, scene
from onboard.view.columns import Columns, scalars, states
from onboard.view.memory import Memory
from onboard.view.motion import Track, sight, truth_at, truth_vector
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
ERROR_WAIT_NS = 1_000_000_000  # an estimate waits so long for a truth after it
NIS_CLIP = 3.0
NONE = np.full(3, np.nan)  # a hole in a curve


def banded(value: float, sigma: float) -> Array:
    """A value and its band's edges, (3,)."""
    return np.array([value, value + scene.SIGMAS * sigma, value - scene.SIGMAS * sigma])


def plot_track(columns: Columns, memory: Memory, t_ns: int, track: Track | None) -> None:
    """Range and components with their bands; holes where there is no track."""
    if track is None:
        for name in ("range", *QUANTITIES.values()):
            columns.add(scalars, f"plots/{name}/estimate", t_ns, NONE)
        return
    seen = sight(track)
    columns.add(scalars, "plots/range/estimate", t_ns, banded(seen.range, seen.sigma))
    for k, name in QUANTITIES.items():
        columns.add(scalars, f"plots/{name}/estimate", t_ns, banded(track.mean[k], track.sigma[k]))
    memory.waiting.append(track)


def plot_truth(columns: Columns, truth: Truth) -> None:
    """The same quantities as they really are."""
    values = truth_vector(truth)
    columns.add(scalars, "plots/range/truth", truth.t_ns, float(np.linalg.norm(values[:3])))
    for k, name in QUANTITIES.items():
        columns.add(scalars, f"plots/{name}/truth", truth.t_ns, values[k])


def plot_errors(columns: Columns, memory: Memory) -> None:
    """Errors of those estimates whose time the truth has reached."""
    newest = memory.truths[-1].t_ns if memory.truths else None
    while memory.waiting and newest is not None and memory.waiting[0].t_ns <= newest:
        track = memory.waiting.popleft()
        truth = truth_at(memory.truths, track.t_ns)
        if truth is None:
            continue
        error, sigma = track.r - truth[:3], track.sigma
        memory.error = float(np.linalg.norm(error))
        seen = sight(track)
        along = seen.range - float(np.linalg.norm(truth[:3]))
        edge = scene.SIGMAS * seen.sigma
        columns.add(scalars, "plots/range_error", track.t_ns, np.array([along, edge, -edge]))
        for k, axis in enumerate(scene.AXIS_NAMES):
            edge = scene.SIGMAS * sigma[k]
            columns.add(scalars, f"plots/error/{axis}", track.t_ns, np.array([error[k], edge, -edge]))


def plot_report(columns: Columns, memory: Memory, report: MeasurementReport, stream: "rr.RecordingStream") -> None:
    """Innovations in sigmas with gates at three, and the NIS with the gate it has to pass."""
    t_ns = report.t_ns
    if report.innovation is not None and report.innovation_sigma is not None:
        sigma = np.asarray(report.innovation_sigma, dtype=float)
        ratio = np.asarray(report.innovation, dtype=float) / np.where(sigma > 0, sigma, np.nan)
        if memory.innovations != len(ratio):
            names = report.components or tuple(str(k) for k in range(len(ratio)))
            colours = [palette.AXES[k % 3] for k in range(len(ratio))]
            scene.log_curves(
                stream, "plots/innovation/value", [(plain(n), c, 1.3) for n, c in zip(names, colours, strict=True)]
            )
            memory.innovations = len(ratio)
        columns.add(scalars, "plots/innovation/value", t_ns, ratio)
        columns.add(scalars, "plots/innovation/gate", t_ns, np.array([scene.SIGMAS, -scene.SIGMAS]))
    if report.nis is not None and report.gate is not None:
        # one wild image must not flatten the plot: what is far beyond the gate stands at its upper edge
        columns.add(scalars, "plots/nis/value", t_ns, np.minimum(report.nis / max(report.gate, 1e-9), NIS_CLIP))
        columns.add(scalars, "plots/nis/gate", t_ns, 1.0)


def plot_health(columns: Columns, memory: Memory, health: Health, stream: "rr.RecordingStream") -> None:
    """How often every stream comes, Hz."""
    for name, one in health.streams.items():
        entity = f"plots/rate/{rr.escape_entity_path_part(name)}"
        if name not in memory.rates:
            stream.log(entity, rr.SeriesLines(names=plain(name), widths=1.5), static=True)
            memory.rates.add(name)
        columns.add(scalars, entity, health.t_ns, one.rate)


def plot_state(columns: Columns, memory: Memory, strip: str, t_ns: int, state: str) -> None:
    """A strip's new state, if it is new."""
    if memory.shown.get(strip) != state:
        memory.shown[strip] = state
        columns.add(states, strip, t_ns, state)


def plot_no_image(columns: Columns, memory: Memory, t_ns: int) -> None:
    """Where images are missing, curves have holes."""
    if memory.innovations and memory.due("no innovation", t_ns, 2.0):
        columns.add(scalars, "plots/innovation/value", t_ns, np.full(memory.innovations, np.nan))


def plot_age(columns: Columns, estimate: Estimate) -> None:
    """How long ago an image was fused, s."""
    age = estimate.age
    columns.add(scalars, "plots/age", estimate.t_ns, np.nan if age is None else age)

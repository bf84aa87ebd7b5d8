"""The paper's figures 6-14, redrawn: measurements, estimates against the truth, errors.

Feet left, SI right.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from onboard.analysis.report.style import STYLE, TRUTH_LINE, panels
from onboard.arrays import Array
from onboard.filters.gating import normalised_squared
from onboard.models.relative_motion import A_LAT, A_LONG, POSITION, SIZE, VELOCITY
from simlink.scenarios.camera import Camera
from studies.relative_motion.flight import Flight
from studies.relative_motion.formation import M_PER_FT, Track
from studies.relative_motion.image_figures import image_points, measured_angles
from studies.relative_motion.report import Result
from studies.relative_motion.scores import relative_acceleration, truth_of
from studies.relative_motion.variant_figures import COLOURS, compared, over_time
from studies.relative_motion.variants import SHOWN
from studies.report.drawing import legend, save

Examples = Mapping[str, Mapping[str, Array]]  # see `over_time`
LABELS: Final = {method.name: method.label for method in SHOWN}
DRAWN: Final = ("paper", "tuned")  # in figures 8-14; the overview shows all
BANDS: Final = " · bands and σ (median): as each filter reports"
FORMATION: Final = (15.0, 30.0)  # s that the formation panel shows
AXES: Final = ("north", "east", "down")


class Components(NamedTuple):
    """Three components of a quantity, each drawn in a panel."""

    title: str
    names: Sequence[str]
    units: Sequence[str]  # in feet
    truth: Array
    estimates: Mapping[str, Array]
    sigmas: Mapping[str, Array] | None


def draw(
    flight: Flight, camera: Camera, tracks: Mapping[str, Track], result: Result, examples: Examples, out: Path
) -> tuple[str, ...]:
    """Write the figures into the folder `out`, and return the file names, the comparison first.

    The comparison shows methods over all variants, the others one flight with its camera.
    """
    with mpl.rc_context(STYLE):
        over_all = {"comparison.png": compared(result.rows, result.bounds), "over-time.png": over_time(examples)}
        return save(over_all, out) + draw_flight(flight, camera, tracks, out)


def draw_flight(flight: Flight, camera: Camera, tracks: Mapping[str, Track], out: Path) -> tuple[str, ...]:
    """Write the figures of one flight with its camera, with the paper's; return the file names."""
    position, velocity, acceleration, target = _quantities(flight, tracks)
    t = flight.nav_t
    with mpl.rc_context(STYLE):
        return save(
            {
                "overview.png": _overview(flight, tracks),
                "figure-06-image-points.png": image_points(flight, camera),
                "figure-07-measurements.png": measured_angles(flight, camera),
                "figure-08-relative-position.png": _against_truth(t, position),
                "figure-09-relative-velocity.png": _against_truth(t, velocity),
                "figure-10-relative-acceleration.png": _against_truth(t, acceleration),
                "figure-11-position-error.png": _errors(t, position),
                "figure-12-velocity-error.png": _errors(t, velocity),
                "figure-13-acceleration-error.png": _errors(t, acceleration),
                "figure-14-target.png": _against_truth(t, target),
            },
            out,
        )


def _quantities(flight: Flight, tracks: Mapping[str, Track]) -> tuple[Components, ...]:
    """Position, velocity, acceleration, and the target's size and accelerations."""
    truth = truth_of(flight)
    shown = {name: tracks[name] for name in DRAWN}
    sigma = {name: np.sqrt(np.einsum("nii->ni", track.covariance)) / M_PER_FT for name, track in shown.items()}

    def states(title: str, names: Sequence[str], units: Sequence[str], columns: Any) -> Components:
        means = {name: track.mean[:, columns] / M_PER_FT for name, track in shown.items()}
        sigmas = {name: rows[:, columns] for name, rows in sigma.items()}
        return Components(title, names, units, truth[:, columns] / M_PER_FT, means, sigmas)

    acceleration = Components(
        "Relative acceleration",
        AXES,
        ["ft/s²"] * 3,
        relative_acceleration(truth, flight) / M_PER_FT,
        {name: relative_acceleration(track.mean, flight) / M_PER_FT for name, track in shown.items()},
        None,
    )
    return (
        states("Relative position", AXES, ["ft"] * 3, POSITION),
        states("Relative velocity", AXES, ["ft/s"] * 3, VELOCITY),
        acceleration,
        states("Target", ("size", "a_lat", "a_long"), ("ft", "ft/s²", "ft/s²"), [SIZE, A_LAT, A_LONG]),
    )


def _three_panels(title: str, q: Components) -> tuple[Figure, Sequence[Axes]]:
    figure, axes = panels(title + (BANDS if q.sigmas is not None else ""), 3, sharex=True)
    axes[-1, 0].set_xlabel("time, s")
    axes[-1, 0].set_xlim(0, 60)
    return figure, axes[:, 0]


def _label(axis: Axes, q: Components, i: int) -> None:
    """Name and unit left, the SI unit right."""
    axis.set_ylabel(f"{q.names[i]}, {q.units[i]}")
    axis.secondary_yaxis("right", functions=(_to_si, _from_si)).set_ylabel(q.units[i].replace("ft", "m"))


def _to_si(y: Any) -> Any:
    return y * M_PER_FT


def _from_si(y: Any) -> Any:
    return y / M_PER_FT


def _against_truth(t: Array, q: Components) -> Figure:
    figure, axes = _three_panels(q.title, q)
    for i, axis in enumerate(axes):
        _set_limits(axis, [q.truth[:, i], *(e[t > 2, i] for e in q.estimates.values())], 0.2)
        for name, estimate in q.estimates.items():
            axis.plot(t, estimate[:, i], color=COLOURS[name], label=LABELS[name])
        axis.plot(t, q.truth[:, i], label="truth", **TRUTH_LINE)
        _bands(axis, t, q, i, q.estimates)
        _label(axis, q, i)
    legend(figure, axes[0])
    return figure


def _errors(t: Array, q: Components) -> Figure:
    figure, axes = _three_panels(f"{q.title}: error", q)
    for i, axis in enumerate(axes):
        errors = {name: estimate - q.truth for name, estimate in q.estimates.items()}
        _set_limits(axis, [e[t > 2, i] for e in errors.values()], 0.25)
        for name, error in errors.items():
            axis.plot(t, error[:, i], color=COLOURS[name], label=LABELS[name])
        axis.axhline(0.0, color="black", linewidth=0.7)
        _bands(axis, t, q, i, {name: np.zeros_like(error) for name, error in errors.items()})
        _label(axis, q, i)
    legend(figure, axes[0])
    return figure


def _bands(axis: Axes, t: Array, q: Components, i: int, centres: Mapping[str, Array]) -> None:
    """Draw one sigma either side for filters with a narrow band; print the medians of all."""
    if q.sigmas is None:
        return
    low, high = axis.get_ylim()
    room = high - low
    for row, (name, sigma) in enumerate(q.sigmas.items()):
        centre, half = centres[name][:, i], sigma[:, i]
        median = float(np.nanmedian(half))
        if median < room:
            axis.fill_between(t, centre - half, centre + half, color=COLOURS[name], alpha=0.16, linewidth=0)
            low = min(low, float(np.nanmin(centre[t > 2])) - median)
            high = max(high, float(np.nanmax(centre[t > 2])) + median)
        axis.text(
            0.995 - 0.22 * row,
            0.97,
            f"σ {median:.2g}" + ("" if median < room else " (off the scale)"),
            color=COLOURS[name],
            transform=axis.transAxes,
            ha="right",
            va="top",
            fontsize=8,
            bbox={"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": 1.0},
        )
    axis.set_ylim(low, high)


def _set_limits(axis: Axes, curves: Sequence[Array], margin: float) -> None:
    """Set the limits by the curves after their start: sigma bands may leave the figure."""
    low = min(float(np.nanmin(c)) for c in curves)
    high = max(float(np.nanmax(c)) for c in curves)
    axis.set_ylim(low - margin * (high - low), high + margin * (high - low))


def _overview(flight: Flight, tracks: Mapping[str, Track]) -> Figure:
    figure, axes = panels("", 2, 3, (10.5, 6.4))
    (plan, ranges, size), (nees, speed, lateral) = axes
    truth, t = truth_of(flight), flight.nav_t
    _formation(plan, flight, tracks)
    for name, track in tracks.items():
        colour, error = COLOURS[name], track.mean - truth
        distance = np.linalg.norm(track.mean[:, POSITION], axis=1) / np.linalg.norm(truth[:, POSITION], axis=1)
        ranges.plot(t, 100 * (distance - 1), color=colour, label=LABELS[name])
        size.plot(t, 100 * error[:, SIZE] / flight.size, color=colour)
        known = np.isfinite(track.mean).all(axis=1)
        nees.semilogy(t[known], normalised_squared(error[known], track.covariance[known]), color=colour)
        speed.plot(t, np.linalg.norm(error[:, VELOCITY], axis=1) / M_PER_FT, color=colour)
        lateral.plot(t, track.mean[:, A_LAT] / M_PER_FT, color=colour)
    nees.axhline(9, color="black", linewidth=0.7)
    lateral.plot(t, truth[:, A_LAT] / M_PER_FT, **TRUTH_LINE)
    speed.set_ylim(0, 4)
    ranges.set_ylim(-12, 12)
    lateral.set_ylim(5, 11)
    titles = {
        ranges: "Range error, %",
        size: "Size error, %",
        nees: "NEES (should average 9)",
        speed: "Velocity error, ft/s",
        lateral: "a_lat, ft/s²",
    }
    for axis, title in titles.items():
        axis.set_title(title, loc="left", fontsize=9.5)
        axis.set_xlim(0, 60)
        axis.set_xlabel("time, s")
    legend(figure, ranges)
    return figure


def _formation(axis: Axes, flight: Flight, tracks: Mapping[str, Track]) -> None:
    """Draw the leader's true and estimated position along and across the follower's heading."""
    v = flight.nav_truth.v_F_n
    heading = np.arctan2(v[:, 1], v[:, 0])
    ahead, right = np.array([np.cos(heading), np.sin(heading)]), np.array([-np.sin(heading), np.cos(heading)])

    shown = (flight.nav_t >= FORMATION[0]) & (flight.nav_t <= FORMATION[1])

    def plot(r: Array, colour: str, style: str) -> None:
        north_east = r[shown, :2].T / M_PER_FT
        along, across = np.sum(ahead[:, shown] * north_east, axis=0), np.sum(right[:, shown] * north_east, axis=0)
        axis.plot(across, along, style, color=colour, linewidth=0.9)

    for name, track in tracks.items():
        plot(track.mean[:, POSITION], COLOURS[name], "-")
    plot(flight.nav_truth.r_FL_n, "black", "--")
    axis.set_title(
        f"The leader from the follower, ft ({FORMATION[0]:g}–{FORMATION[1]:g} s)", loc="left", fontsize=9.5
    )
    axis.set_xlabel("to the right")
    axis.set_ylabel("ahead")

"""Figures 2-14 of Varaprasad et al., redrawn from the first ascent."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from onboard.analysis.report.style import STYLE, panels
from onboard.models import radar
from studies.report.drawing import COLOURS, legend, save, within_sigma
from studies.tracking.outcomes import POSITION, VELOCITY
from studies.tracking.trajectories import load
from studies.ukf_radar_launch_vehicle.runs import EVENTS, Results, times

AXES = ("east", "north", "up")


def draw(single: Results, triple: Results, out: Path) -> tuple[str, ...]:
    """Write the figures into the folder `out`; their names."""
    with mpl.rc_context(STYLE):
        return save(
            {
                "figure-02-04-first-differences.png": _differences(single),
                "figure-05-10-errors.png": _errors(single),
                "figure-11-14-position-and-velocity.png": _lengths(single, triple),
            },
            out,
        )


def _differences(single: Results) -> Figure:
    figure, axes = panels("Figures 2-4: first differences of the measurements, raw and filtered", 3)
    t, filtered = times()[1:], radar.measure(np.ascontiguousarray(single.outcomes["ukf"].first_mean))
    scales = (1.0, 1e3, 1e3)
    for i, name in enumerate(("slant range, m", "azimuth, mrad", "elevation, mrad")):
        axis = axes[i, 0]
        axis.plot(t, scales[i] * np.diff(single.measured[:, i]), color=COLOURS["ekf"], linewidth=0.4, label="raw")
        axis.plot(t, scales[i] * np.diff(filtered[:, i]), color=COLOURS["ukf"], label="filtered")
        low, high = scales[i] * np.quantile(np.diff(single.measured[50:, i]), [0, 1])
        axis.set_ylim(low - 0.1 * (high - low), high + 0.1 * (high - low))
        axis.set_ylabel(name)
    axes[-1, 0].set_xlabel("time, s")
    legend(figure, axes[0, 0])
    return figure


def _errors(single: Results) -> Figure:
    figure, axes = panels("Figures 5-10: errors of the unscented filter, and its ±1σ", 3, 2, (10.5, 7.5))
    t, error = times(), single.outcomes["ukf"].first_mean - load("launch-vehicle").states[1:]
    for column, (states, unit) in enumerate(((POSITION, "m"), (VELOCITY, "m/s"))):
        for row, state in enumerate(states):
            axis, sigma = axes[row, column], single.sigma["ukf"][:, state]
            within_sigma(axis, t, error[:, state], sigma, COLOURS["ukf"], "error")
            limit = 4 * float(np.median(sigma[100:]))
            axis.set_ylim(-limit, limit)
            axis.set_ylabel(f"{AXES[row]}, {unit}")
            for event in EVENTS:
                axis.axvline(event, color="black", linewidth=0.3, alpha=0.5)
        axes[-1, column].set_xlabel("time, s (thin lines: events of the thrust)")
    legend(figure, axes[0, 0])
    return figure


def _lengths(single: Results, triple: Results) -> Figure:
    figure, axes = panels(
        "Figures 11-14: position and velocity errors, root mean square over runs", 2, 2, (10.5, 6.4)
    )
    t = times()
    for row, (results, noise) in enumerate(((single, "1σ noise"), (triple, "3σ noise"))):
        for column, (states, unit) in enumerate(((POSITION, "m"), (VELOCITY, "m/s"))):
            axis = axes[row, column]
            for name, style in (("ekf", "-"), ("ukf", "--")):
                o = results.outcomes[name]
                length = np.linalg.norm(o.rms[:, states], axis=1)
                axis.semilogy(t, length, style, color=COLOURS[name], label=o.label)
            claimed = ((5.0, 5.0), (10.0, 5.0))[row][column]
            axis.axhline(claimed, color="black", linewidth=0.8, label="claimed (unscented)")
            axis.set_ylabel(f"{('position', 'velocity')[column]}, {unit} ({noise})")
    for axis in axes[-1]:
        axis.set_xlabel("time, s")
    legend(figure, axes[0, 0])
    return figure

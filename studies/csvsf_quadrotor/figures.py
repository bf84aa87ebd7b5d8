"""The quadrotor study's figures, in SI units, NED, body rates.

They are the paper's 3-5, the same with modelling errors, and the differences between the filters.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from onboard.analysis.report.style import STYLE, panels
from onboard.arrays import Array
from onboard.filters.cubature_smooth import FADING_FRACTION, MIN_EXCEEDANCE_STEPS
from onboard.models.quadrotor import COMPONENTS, INPUTS
from studies.csvsf_quadrotor.cases import FAULT_TIME_S, NAMED, Case
from studies.csvsf_quadrotor.filters import ADAPTIVE, CKF, MAIN, METHODS, PRINTED, RECURSIVE, SVSF, Track
from studies.csvsf_quadrotor.reference_flight import DT
from studies.csvsf_quadrotor.report import Result, Setting
from studies.report.drawing import legend, save
from studies.report.runs import by_name

DRAWN: Final = (CKF, SVSF, PRINTED, RECURSIVE, ADAPTIVE)
COLOURS: Final = {
    CKF.name: "#0072b2",
    SVSF.name: "#999999",
    PRINTED.name: "#d55e00",
    RECURSIVE.name: "#cc79a7",
    ADAPTIVE.name: "#009e73",
}
WIDTHS: Final = {CKF.name: 2.4, SVSF.name: 0.6}  # others may lie on the CKF's curve
UNITS: Final = {"u": "N", "d_roll": "N", "d_pitch": "N", "d_yaw": "N m"}
SHOWN: Final = (9.5, 11.5)  # s of the upper panels
ZD, P_RATE, Q_RATE = COMPONENTS.index("zd"), COMPONENTS.index("p"), COMPONENTS.index("q")
Flights = Mapping[str, tuple[Case, Mapping[str, Track]]]


def draw(flights: Flights, result: Result, out: Path) -> tuple[str, ...]:
    """Write the figures into the folder `out`; returns the file names, the overview first."""
    clean, weak, motor = flights["none"], flights["weak"], flights["motor"]
    p = "p, rad/s (roll rate, body)"
    with mpl.rc_context(STYLE):
        return save(
            {
                "overview.png": _overview(result),
                "figure-03-inputs.png": _inputs(clean[0]),
                "figure-04-roll-rate-frame.png": _estimates(
                    clean, roll_rate, "phi', rad/s (roll rate, frame)", "none"
                ),
                "figure-05-roll-rate-body.png": _estimates(clean, lambda x: x[..., P_RATE], p, "none"),
                "velocity-inputs-weak.png": _estimates(weak, lambda x: x[..., ZD], "z', m/s (down)", "weak"),
                "pitch-rate-motor-weak.png": _estimates(motor, lambda x: x[..., Q_RATE], "q, rad/s", "motor"),
                "model-error-meter.png": _meter(flights),
                "settings.png": _settings(result.sweep),
            },
            out,
        )


def roll_rate(states: Array) -> Array:
    """phi' of states (..., 12), in rad/s."""
    phi, p, theta, q, r = (states[..., COMPONENTS.index(name)] for name in ("phi", "p", "theta", "q", "r"))
    return np.asarray(p + (q * np.sin(phi) + r * np.cos(phi)) * np.tan(theta))


def _overview(result: Result) -> Figure:
    """Velocity error of each method, a panel for each of the reference's columns."""
    title = f"Velocity error, 10–20 s, {result.seeds} flights · bar: another implementation · dashed: the sensor"
    figure, axes = panels(title, 1, len(MAIN), (10.0, 4.2), sharey=True)
    rows = by_name(result.rows)
    reference = {(c.variant, c.method): c.reference for c in result.comparisons}
    y = np.arange(len(METHODS))[::-1]
    raw = rows["none", SVSF.name].value("velocity_m_s")
    for ax, variant in zip(axes[0], MAIN, strict=True):
        ax.axvline(raw, color="#999999", lw=0.8, ls="--")
        for at, method in zip(y, METHODS, strict=True):
            value, colour = rows[variant, method.name].value("velocity_m_s"), COLOURS.get(method.name, "#444444")
            ax.plot(value, at, "o", color=colour, zorder=3)
            ax.plot(reference.get((variant, method.name), np.nan), at, "|", color="black", ms=12)
        ax.set(xscale="log", xlim=(0.008, 1.0), xlabel="velocity, m/s")
        ax.set_title(NAMED[variant].label, fontsize=8)
    axes[0, 0].set_yticks(y, [m.label for m in METHODS])
    return figure


def _inputs(case: Case) -> Figure:
    figure, axes = panels("The inputs of the flight", 2, 2, (8.0, 5.0), sharex=True)
    t = np.arange(len(case.inputs)) * DT
    for k, (ax, name) in enumerate(zip(axes.flat, INPUTS, strict=True)):
        ax.plot(t, case.inputs[:, 0, k], color="#0072b2", lw=0.6)
        ax.set(ylabel=f"{name}, {UNITS[name]}", xlabel="time, s" if k > 1 else "")
    return figure


def _estimates(flown: tuple[Case, Mapping[str, Track]], quantity: Any, name: str, variant: str) -> Figure:
    """Draw truth and estimates about the beginning of faults, and the errors over the flight."""
    case, tracks = flown
    figure, ((above,), (below,)) = panels(f"{name} · {NAMED[variant].label} · black: truth", 2, size=(9.0, 6.0))
    truth = quantity(case.states[1:, 0])
    t = (1 + np.arange(len(truth))) * DT
    near = (t >= SHOWN[0]) & (t <= SHOWN[1])
    above.plot(t[near], truth[near], color="black", lw=1.6)
    for method in DRAWN:
        estimate = quantity(tracks[method.name].mean[:, 0])
        rms = float(np.sqrt(np.mean((estimate - truth)[t > FAULT_TIME_S] ** 2)))
        style = {"color": COLOURS[method.name], "lw": WIDTHS.get(method.name, 1.0)}
        above.plot(t[near], estimate[near], **style)
        below.plot(t, _moving_rms(estimate - truth), label=f"{method.label}: {rms:.3g} from 10 s", **style)
    above.set(ylabel=name)
    below.set(ylabel="rms error, over half a second", xlabel="time, s", yscale="log")
    for ax in (above, below):
        _fault(ax, variant)
    legend(figure, below, columns=3)
    return figure


def _moving_rms(error: Array) -> Array:
    """Return the RMS of an error (N,) over the half second before each sample, NaN at first."""
    width = round(0.5 / DT)
    found = np.full(len(error), np.nan)
    means = np.convolve(error**2, np.full(width, 1 / width), "valid")
    found[width - 1 :] = np.sqrt(means)
    return found


def _meter(flights: Flights) -> Figure:
    """The adaptive form's fading mean of sat(e/layer), of two quantities in four flights."""
    title = "A measure of the model's error: the mean of sat(e / layer); green: the range of white noise"
    figure, grid = panels(title, len(MAIN), 2, (9.0, 6.0), sharex=True, sharey=True)
    limit = float(np.sqrt(FADING_FRACTION / (2 - FADING_FRACTION)))
    for row, variant in zip(grid, MAIN, strict=True):
        switching = flights[variant][1][ADAPTIVE.name].switching[:, 0]
        t = (1 + np.arange(len(switching))) * DT
        for ax, component in zip(row, (ZD, Q_RATE), strict=True):
            ax.axhspan(-limit, limit, color="#009e73", alpha=0.12)
            ax.plot(t, switching[:, component], color="#009e73", lw=0.6)
            ax.set_title(f"{COMPONENTS[component]} · {NAMED[variant].label}", fontsize=8)
            _fault(ax, variant)
    grid[-1][0].set(xlabel="time, s", ylim=(-1, 1))
    grid[-1][1].set(xlabel="time, s")
    return figure


def _settings(sweep: Sequence[Setting]) -> Figure:
    """The four figures that are asked for with other settings, each over its limit."""
    title = "Settings of the adaptive form, on the seeds for choosing: below 1 is met"
    figure, ((left, right),) = panels(title, 1, 2, (9.0, 3.6), sharey=True)
    wanted = {
        "no error (CKF + 1 %)": ("none_m_s", _chosen(sweep).none_m_s * 1.01, "#0072b2"),
        "inputs x .7 (.09 m/s)": ("weak_m_s", 0.09, "#d55e00"),
        "outliers (.016 m/s)": ("outliers_m_s", 0.016, "#cc79a7"),
        "weak motor (.06 rad/s)": ("motor_rad_s", 0.06, "#009e73"),
    }
    for ax, by, fixed in ((left, "fading", "patience"), (right, "patience", "fading")):
        some = [
            s
            for s in sweep
            if getattr(s, fixed) == (MIN_EXCEEDANCE_STEPS if fixed == "patience" else FADING_FRACTION)
        ]
        some.sort(key=lambda s: float(getattr(s, by)))
        x = [getattr(s, by) for s in some]
        for label, (name, limit, colour) in wanted.items():
            ax.plot(x, [getattr(s, name) / limit for s in some], "o-", color=colour, label=label)
        ax.axhline(1.0, color="black", lw=0.8, ls="--")
        ax.axvline(FADING_FRACTION if by == "fading" else MIN_EXCEEDANCE_STEPS, color="#999999", lw=0.8)
        ax.set(xlabel=by, xscale="log", yscale="log")
        ax.set_xticks(x, [f"{v:g}" for v in x])
        ax.set_yticks([0.3, 0.5, 1, 2, 5, 10], ["0.3", "0.5", "1", "2", "5", "10"])
        ax.minorticks_off()
    left.set_ylabel("error over its limit")
    left.legend(fontsize=7)
    return figure


def _chosen(sweep: Sequence[Setting]) -> Setting:
    return next(s for s in sweep if (s.fading, s.patience) == (FADING_FRACTION, MIN_EXCEEDANCE_STEPS))


def _fault(ax: Axes, variant: str) -> None:
    if variant in ("weak", "motor"):
        ax.axvline(FAULT_TIME_S, color="black", lw=0.8, ls=":")

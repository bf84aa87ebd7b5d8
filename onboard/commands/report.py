"""`onboard report`: a flight on one page, with a verdict that a pilot reads in a minute."""

import argparse
import datetime
import math
from importlib.util import find_spec
from pathlib import Path

import msgspec

from onboard import UserError, __version__, with_extra
from onboard.analysis.flights.replay import ReplayResult, check_log, flight_of, replay
from onboard.analysis.report.series import FlightSeries
from onboard.analysis.report.vehicle import Parameter, VehicleSeries
from onboard.analysis.report.verdict import AUTOPILOT_RATES, OUR_RATES, STREAM_RATES, Grade, judge, worst
from onboard.config import Config, load_config
from onboard.messages import Output
from onboard.scoring.beside import judged
from onboard.scoring.leader import LeaderScorer
from onboard.scoring.reference import reference_from_csv
from onboard.terminal.console import Console
from onboard.terminal.files import check_targets
from onboard.terminal.output import one_line
from onboard.terminal.progress import progress_bar
from onboard.units import NS_PER_S, S_PER_NS
from onboard.wire.logs.recording import is_recording, parts_of

OF_AUTOPILOT = {".bin", ".ulg"}
MIN_UNIX_TIME_S = 1e9  # of Unix time; before it, arrivals are on a boot clock


def main(arguments: argparse.Namespace) -> int:
    """Replay a log and write its report; 1 for a flight that FAILs. Raises UserError."""
    a = arguments
    if find_spec("matplotlib") is None:
        raise UserError(f"a report's figures need matplotlib: {with_extra('study')}")
    flight = flight_of(a.log)
    config = load_config(a.config or flight.config, tuple(a.set))
    out = a.out or Path(f"{a.log.name.partition('.')[0]}-report.html")
    check_targets(out, a.pdf, inputs=(flight.log, a.config, a.truth))
    check_log(a.log)
    grade = write_report(a.log, config, out=out, pdf=a.pdf, truth=a.truth or flight.truth)
    return 1 if grade is Grade.FAIL else 0


def write_report(log: Path, config: Config, *, out: Path, pdf: Path | None, truth: Path | None) -> Grade:
    """Replay a log, write the page to `out` and `pdf`, and print the verdict. Raises UserError."""
    from onboard.analysis.report.figures import figures  # noqa: PLC0415 - Matplotlib is an extra
    from onboard.analysis.report.page import FlightReport, html, summary, write_pdf  # noqa: PLC0415
    from onboard.analysis.report.vehicle_figures import vehicle_figures  # noqa: PLC0415

    reference = reference_from_csv(truth) if truth is not None else None
    series, scorer = FlightSeries(judged(config.estimator)), LeaderScorer(reference)
    vehicle = VehicleSeries()

    def take(output: Output) -> None:
        series.add(output)
        if getattr(output, "name", "") == series.estimator and getattr(output, "is_primary", False):
            scorer.add(output)  # type: ignore[arg-type]

    with progress_bar(Console(stderr=True)) as bar:
        task = bar.add_task(one_line(f"replaying {log.name}"), total=None)
        replayed = replay(
            log,
            config,
            take=take,
            hear=vehicle.hear,
            progress=lambda done, total: bar.update(task, completed=done, total=total),
            keep=False,
        )
    own_rates = OUR_RATES if is_recording(flight_of(log).log) else STREAM_RATES
    rates = AUTOPILOT_RATES if log.suffix.lower() in OF_AUTOPILOT else own_rates
    checks = judge(series, scorer.score(replayed.end), replayed, rates=rates)
    report = FlightReport(
        title=f"Flight report: {log.name}",
        facts=_facts(log, config, replayed, truth),
        checks=checks,
        figures=figures(series, scorer.errors(), reference) | vehicle_figures(vehicle),
        tables=_tables(series, replayed) | {"Modes and messages": _words(vehicle)},
        parameters=_parameters(vehicle),
        configuration=msgspec.json.format(msgspec.json.encode(config), indent=1).decode(),
    )
    try:
        out.write_text(html(report), encoding="utf-8")
        if pdf is not None:
            write_pdf(report, pdf)
    except OSError as error:
        raise UserError(f"cannot write {out}: {error.strerror}") from error
    console = Console()
    console.print(f"{worst(checks)}: {summary(checks)}", highlight=False, soft_wrap=True)
    for path in (out, pdf):
        if path is not None:
            console.print(f"written: {path}", highlight=False, soft_wrap=True)
    return worst(checks)


def _facts(log: Path, config: Config, replayed: ReplayResult, truth: Path | None) -> list[tuple[str, str]]:
    health = replayed.health
    end_s = health.t_recv_ns * S_PER_NS
    begin = datetime.datetime.fromtimestamp(end_s - replayed.duration, datetime.UTC)
    offset = "none" if health.clock_offset_ns is None else f"{health.clock_offset_ns * S_PER_NS:.3f} s ahead of it"
    parts = ", ".join(part.name for part in (log, *parts_of(flight_of(log).log)[1:]))
    trip = "" if health.round_trip is None else f", round trip {health.round_trip * 1e3:.1f} ms"
    return [
        ("log", f"{parts}, {replayed.records} records, {replayed.damaged} damaged"),
        (
            "begin",
            f"{begin:%Y-%m-%d %H:%M:%S} UTC" if end_s > MIN_UNIX_TIME_S else "not known: no clock of the world",
        ),
        ("duration", f"{replayed.duration / 60:.1f} min"),
        ("autopilot", health.autopilot),
        ("estimators", ", ".join(config.estimator)),
        ("clocks", f"boot clock by {health.clock_source}: ours is {offset}{trip}, rate {health.clock_rate:.4f}"),
        ("truth", truth.name if truth is not None else "none: only what needs no truth is judged"),
        ("program", f"wingline {__version__}; the log was replayed with it"),
    ]


def _tables(series: FlightSeries, replayed: ReplayResult) -> dict[str, list[tuple[str, ...]]]:
    health, seconds = replayed.health, max(replayed.duration, 1e-9)
    rejected = sorted(series.rejected.items(), key=lambda one: -one[1].number)
    return {
        "Rejected images": [
            ("verdict", "images", "first, s", "last, s"),
            *((str(v), str(r.number), f"{r.first_s:.2f}", f"{r.last_s:.2f}") for v, r in rejected),
        ],
        "Refused messages": [
            ("reason", "source", "messages", "last, s"),
            *((r.reason, r.source, str(r.count), _boot_s(r.t_recv_ns, replayed)) for r in health.refusals),
        ],
        "Counted": [("what", "messages"), *((name, str(n)) for name, n in sorted(health.rejected.items()))],
        "Faults of our own vehicle": [
            ("fault", "from, s", "size"),
            *(
                (f.name, f"{f.t_onset_ns * S_PER_NS:.2f}", f"{f.magnitude:.2f} {f.unit}")
                for f in series.faults.values()
            ),
        ],
        "Streams": [
            ("message", "messages", "rate, Hz"),
            *((n, str(s.count), f"{s.count / seconds:.1f}") for n, s in sorted(health.streams.items())),
        ],
    }


def _words(vehicle: VehicleSeries) -> list[tuple[str, ...]]:
    rows = [(f"{t:.2f}", kind, text) for t, kind, text in vehicle.words]
    more = [("", "", f"and {vehicle.left_out} more")] if vehicle.left_out else []
    return [("time, s", "kind", "words"), *rows, *more]


def _parameters(vehicle: VehicleSeries) -> list[tuple[str, ...]]:
    """Those that are not as by default, or were set in flight, first."""
    kept = sorted(vehicle.parameters.items(), key=lambda one: (not one[1].is_changed, one[0]))
    left = vehicle.parameters_left_out
    more = [(f"and {left} more", "", "", "")] if left else []
    rows = [(name, _number(p.value), _number(p.default), _was_set(p)) for name, p in kept]
    return [("parameter", "value", "default", "set in flight"), *rows, *more]


def _was_set(p: Parameter) -> str:
    return f"at {p.set_s:.2f} s, from {_number(p.first)}" if p.first != p.value and not math.isnan(p.first) else ""


def _number(value: float | None) -> str:
    """Format a number with the digits of 32 bits. A whole number keeps all, as it may be a mask or an identity."""
    if value is None:
        return ""
    return f"{value:.0f}" if value.is_integer() else f"{value:.7g}"


def _boot_s(t_recv_ns: int, replayed: ReplayResult) -> str:
    """An arrival on the boot clock; "" before the first record, as of a row without a time."""
    if t_recv_ns < replayed.health.t_recv_ns - replayed.duration * NS_PER_S:
        return ""
    return f"{replayed.end + (t_recv_ns - replayed.health.t_recv_ns) * S_PER_NS:.2f}"

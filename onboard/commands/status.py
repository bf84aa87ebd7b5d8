"""`onboard status`: what a running daemon hears, what is wrong, and the line to type or the key to change.

It reads the health that the daemon publishes over Zenoh, whose advice is that of the daemon's own lines, of the
view and of the pilot's STATUSTEXT. Where no daemon answers, it looks for the reason on this computer."""

import argparse
import sys
import time
from typing import Final

import msgspec

from onboard.commands.absent import why_absent
from onboard.config import Config, load_config
from onboard.messages import Advice, Health, LinkHealth, Severity
from onboard.messages.causes import NO_REASON, Cause, Reason
from onboard.messages.text import plain
from onboard.sinks.sink import SinkError
from onboard.sinks.zenoh_reach import worst
from onboard.units import S_PER_NS
from onboard.view.client import Client

DEFAULT_ENDPOINT: Final = "tcp/127.0.0.1:7447"
ALL: Final = "all"
HEALTH_TIMEOUT_S: Final = 3.0  # for a first health, which comes once a second
GATHERING_TIME_S: Final = 1.5  # in which each vehicle that runs has sent one
HEALTHY, NOT_HEALTHY = 0, 1
CLEAR: Final = "\x1b[2J\x1b[H"
SHOWN_REFUSAL_COUNT: Final = 5  # refusals
MAX_COLUMN_WIDTH: Final = 240  # letters of a column


def main(arguments: argparse.Namespace) -> int:
    """Print the status once, or whenever it changes. Exit code 0: healthy. Raises UserError."""
    a = arguments
    config = load_config(a.config, tuple(a.set))
    only = None if a.vehicle in (None, ALL) else a.vehicle
    client, errors = None, dict[str, SinkError]()
    for endpoint in [a.connect] if a.connect else _endpoints(config):
        try:
            client = Client(endpoint, only, config.zenoh)
            break
        except SinkError as error:
            errors[endpoint] = error
    if client is None:
        words = "; ".join(map(str, errors.values()))
        cause = worst(getattr(error, "cause", Cause.UNREACHABLE) for error in errors.values())
        return _show_absent(why_absent(config, " or ".join(errors), Reason(cause, words)), as_json=a.json)
    try:
        return _watch(client, a, config, endpoint)
    finally:
        client.close()


def _endpoints(config: Config) -> tuple[str, ...]:
    """Return the endpoints of the daemon: its own, otherwise those of its routers, which may be off."""
    return (*config.zenoh.listens(), *config.zenoh.connect) or (DEFAULT_ENDPOINT,)


def _watch(client: Client, a: argparse.Namespace, config: Config, endpoint: str) -> int:
    """Show the health of each vehicle: once, or until interrupted."""
    found: dict[str, Health] = {}
    begin = time.monotonic()
    while a.watch or time.monotonic() < begin + (_patience(a) if found else HEALTH_TIMEOUT_S):
        received = client.take(0.2)
        if received is None or not isinstance(received.record, Health):
            continue
        found[received.vehicle] = received.record
        if a.watch:
            _show(found, as_json=a.json, clear=sys.stdout.isatty() and not a.json)
    if not found:
        advice = why_absent(config, endpoint, NO_REASON, a.vehicle or "", client.unread)
        return _show_absent(advice, as_json=a.json)
    if not a.watch:
        _show(found, as_json=a.json)
    return HEALTHY if all(map(is_healthy, found.values())) else NOT_HEALTHY


def _patience(a: argparse.Namespace) -> float:
    """Return the time, s, to wait for further vehicles."""
    return GATHERING_TIME_S if a.vehicle in (None, ALL) else 0.0


def is_healthy(health: Health) -> bool:
    """Whether nothing is wrong; a notice is not wrong as long as it is meant."""
    return all(advice.severity is Severity.NOTICE for advice in health.advice)


def _show(found: dict[str, Health], *, as_json: bool, clear: bool = False) -> None:
    if as_json:
        for vehicle, health in found.items():
            document = {"vehicle": vehicle, "healthy": is_healthy(health), "health": health}
            print(msgspec.json.encode(document).decode(), flush=True)
        return
    text = "\n\n".join(describe(vehicle, health) for vehicle, health in sorted(found.items()))
    print(f"{CLEAR if clear else ''}{text}", flush=True)


def _show_absent(advice: tuple[Advice, ...], *, as_json: bool) -> int:
    if as_json:
        print(msgspec.json.encode({"vehicle": None, "healthy": False, "advice": advice}).decode())
    else:
        print("\n".join(["NOT HEALTHY", *_advice(advice)]))
    return NOT_HEALTHY


def describe(vehicle: str, health: Health) -> str:
    """The status of one vehicle as text."""
    verdict = "healthy" if is_healthy(health) else "NOT HEALTHY"
    lines = [f"vehicle {vehicle}: {verdict}, up {health.uptime:.0f} s", *_advice(health.advice), ""]
    lines += _autopilot(health)
    lines += _table(
        ["stream", "Hz", "needed", "age s", "count"],
        [
            [name, *_stream(health, name)]
            for name in sorted({*health.streams, *health.needed}, key=lambda n: (n not in health.needed, n))
        ],
    )
    lines += _table(
        ["camera", "Hz", "age s", "late s", "lead s", "clock", "targets", "classes"],
        [
            [
                *(name, f"{c.rate:.1f}", f"{c.age:.2f}", _s(c.latency), _s(c.lead), c.clock or "-"),
                *(", ".join(n or "(none)" for n in c.targets), ", ".join(c.classes) or "-"),
            ]
            for name, c in health.cameras.items()
        ],
    )
    lines += _table(
        ["estimator", "state", "reason"],
        [[name, state.value, health.reasons.get(name, "")] for name, state in health.states.items()],
    )
    lines += _table(
        ["innovations", "NIS", "bounds", "noise", "count"],
        [
            [name, f"{c.nis:.2f}", f"{c.low:.2f}-{c.high:.2f}", f"x{c.noise:.1f}", str(c.count)]
            for name, c in health.consistency.items()
        ],
    )
    return "\n".join([*lines, *_rejected(health), *_drops(health), _computer(health)])


def _advice(advice: tuple[Advice, ...]) -> list[str]:
    lines = []
    for one in advice:
        times = f" ({one.count} times)" if one.count > 1 else ""
        lines.append(f"  {one.severity.upper():8}{one.what}{times}")
        lines += [f"{'':10}-> {one.remedy}"] if one.remedy else []
    return lines


def _autopilot(health: Health) -> list[str]:
    beside = f"; also heard: {'; '.join(health.beside)}" if health.beside else ""
    trip = "none" if health.round_trip is None else f"{1e3 * health.round_trip:.1f} ms"
    offset = "unknown" if health.clock_offset_ns is None else f"{health.clock_offset_ns * S_PER_NS:.4f} s"
    senders = ", ".join(f"{name} ({count})" for name, count in sorted(health.senders.items()))
    return [
        f"autopilot  {health.autopilot}{beside}; reboots {health.autopilot_reboots}",
        f"heard      {senders or 'nothing'} (MAVLink system/component, messages)",
        f"clock      by {health.clock_source}; offset {offset}; round trip {trip}; rate {health.clock_rate:.4f}",
    ]


def _stream(health: Health, name: str) -> list[str]:
    needed = f"{health.needed[name]:g}" if name in health.needed else "-"
    stream = health.streams.get(name)
    if stream is None:
        return ["0.0", needed, "never", "0"]
    return [f"{stream.rate:.1f}", needed, f"{stream.age:.2f}", str(stream.count)]


def _rejected(health: Health) -> list[str]:
    counts = ", ".join(f"{name} {count}" for name, count in sorted(health.rejected.items()))
    lines = ["", f"rejected   {counts or 'nothing'}"]
    for r in health.refusals[-SHOWN_REFUSAL_COUNT:]:
        age = (health.t_recv_ns - r.t_recv_ns) * S_PER_NS
        lines.append(f"           {age:.0f} s ago, {r.source}: {r.reason} ({r.count} times)")
    return lines


def _drops(health: Health) -> list[str]:
    sinks = [
        f"{name} dropped {s.dropped} of {s.sent + s.dropped}" + (f" ({s.error})" if s.error else "")
        for name, s in health.sinks.items()
    ]
    return [f"drops      {'; '.join([*map(_link, health.links.items()), *sinks]) or 'nothing'}"]


def _link(named: tuple[str, LinkHealth]) -> str:
    name, link = named
    return f"link {name} received {link.received}, lost {link.dropped + link.shed}, errors {link.errors}"


def _computer(health: Health) -> str:
    c = health.computer
    is_known = c.cpu is not None and c.cpu_busiest is not None
    cpu = f"{c.cpu:.0f} %, busiest core {c.cpu_busiest:.0f} %" if is_known else "unknown"
    memory, storage = (
        "unknown" if free is None else f"{free / 1e9:.1f} GB free" for free in (c.memory_free, c.storage_free)
    )
    return f"computer   CPU {cpu}; memory {memory}; storage {storage}; timer late by {1e3 * c.lag:.0f} ms"


def _s(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _table(head: list[str], rows: list[list[str]]) -> list[str]:
    """Columns of text, the first and those of words to the left."""
    if not rows:
        return []
    rows = [[plain(cell, MAX_COLUMN_WIDTH) for cell in row] for row in rows]
    widths = [max(len(row[k]) for row in (head, *rows)) for k in range(len(head))]
    lines = [""]
    for row in (head, *rows):
        cells = [
            cell.rjust(width) if k and _is_number(rows[0][k]) else cell.ljust(width)
            for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        lines.append("  ".join(cells).rstrip())
    return lines


def _is_number(cell: str) -> bool:
    return cell[:1] in "-0123456789x" or cell == "never"

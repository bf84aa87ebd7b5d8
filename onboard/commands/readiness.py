"""Findings of `onboard check`: the daemon's health, and this computer's disk and clock.

Where a daemon of this configuration runs, it is asked. Else one listens here for some seconds: it sends the
autopilot heartbeats and requests for rates as in flight, nothing of the leader, and it records and stores nothing.
Each line gathers the health's advice on one thing, so what is wrong is said in the words of `onboard status`."""

import asyncio
import os
import shutil
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple

from msgspec.structs import replace

from onboard import UserError
from onboard.commands.absent import why_absent
from onboard.commands.status import DEFAULT_ENDPOINT
from onboard.config import (
    Config,
    OdometryConfig,
    ParametersConfig,
    RecorderConfig,
    TrafficOutConfig,
    WarmStartConfig,
    load_config,
)
from onboard.daemon import Daemon
from onboard.health.causes_host import MIN_STORAGE_BYTES
from onboard.health.needs import RATE_SHARE
from onboard.messages import Advice, Health, Severity
from onboard.messages.causes import Cause, Reason
from onboard.pipeline.needs import needs
from onboard.sinks.recorder import MIN_UNIX_TIME_S
from onboard.sinks.sink import SinkError
from onboard.units import S_PER_NS
from onboard.view.client import Client

ANSWER_TIMEOUT_S: Final = 3.0  # for a daemon that runs to send its health, which comes once a second
SETTLING_TIME_S: Final = 6.0  # of listening, before all is well: what is missing has advice after 5 s
# The causes of advice (docs/status.md) that each line gathers; what is left is on a line of its own.
TOPICS: Final = {
    "links": ("link", "tls", "port", "name"),
    "autopilot": ("autopilot-silent", "system", "component", "signing"),
    "rates": ("attitude", "stream", "position", "rates", "origin"),
    "camera": (
        *("camera-silent", "camera", "target", "class", "clock", "stamps", "pixels", "lens", "noise"),
        "mount",
    ),
    "clock": ("timesync",),
    "disk": ("disk",),
}
COLUMN: Final = 12


class Finding(NamedTuple):
    """A line: what was looked at, and what was found. `is_needed`: it fails, and without it there is no flight.
    `is_doubt`: worth knowing."""

    name: str
    words: str
    remedies: tuple[str, ...] = ()
    is_needed: bool = False
    is_doubt: bool = False

    def __str__(self) -> str:
        mark = "FAIL" if self.is_needed else "note" if self.is_doubt else "ok"
        below = "".join(f"\n{'':{COLUMN + 5}}-> {remedy}" for remedy in self.remedies)
        return f"{mark:5}{self.name:{COLUMN}}{self.words}{below}"

    @classmethod
    def fine(cls, name: str, words: str) -> "Finding":
        """Nothing is wrong."""
        return cls(name, words)

    @classmethod
    def fails(cls, name: str, words: str, *remedies: str) -> "Finding":
        """Something needed is missing."""
        return cls(name, words, remedies, is_needed=True)


def load(path: Path | None, overrides: tuple[str, ...]) -> Config:
    """The configuration, and every module that flies with it. Raises UserError."""
    config = load_config(path, overrides)
    Daemon(_quiet(config), report=lambda _: None)
    return config


def check(config: Config, wait_s: float, report: Callable[[str], None]) -> bool:
    """Report every line; whether nothing that is needed is missing. It takes some seconds more than `wait_s`."""
    lines = [_disk(config), _clock(config, time.time_ns() * S_PER_NS)]
    for line in lines:
        _show(line, report)
    try:
        health, whose = _running(config), "a daemon that runs"
        if health is None:
            report(f"     listening for at most {wait_s:g} s")
            health, whose = asyncio.run(listen(config, wait_s)), "this check"
    except UserError as error:
        found = why_absent(config, "this computer", Reason(Cause.UNREACHABLE, str(error)))
        lines.append(
            Finding.fails("links", str(error), *(f"{a.what}: {a.remedy}" for a in found if a.kind == "port"))
        )
        _show(lines[-1], report)
        return False
    if health is None:
        lines.append(Finding.fails("links", f"not open after {wait_s:g} s: does a name server answer?"))
        _show(lines[-1], report)
        return False
    for line in judged(config, health, whose):
        lines.append(line)
        _show(line, report)
    return not any(line.is_needed for line in lines)


def _show(line: Finding, report: Callable[[str], None]) -> None:
    for part in str(line).split("\n"):
        report(part)


def judged(config: Config, health: Health, whose: str) -> Iterator[Finding]:
    """A health as lines."""
    advice = list(health.advice)
    for name, words in (
        ("links", _links(health)),
        ("autopilot", f"{health.autopilot}, heard by {whose}" if health.followed else "none is heard"),
        ("rates", _rates(health)),
        ("camera", _cameras(config, health)),
        ("clock", _offset(health)),
        ("disk", ""),
    ):
        mine = [a for a in advice if a.kind in TOPICS[name]]
        advice = [a for a in advice if a not in mine]
        if words or mine:
            yield _gathered(name, words, mine, fails=name in _missing(config, health))
    for one in advice:
        yield _gathered(one.kind, "", [one])


def _gathered(name: str, words: str, advice: Iterable[Advice], *, fails: bool = False) -> Finding:
    """A line of what was found, and of the advice on it. A link that is tried again is a warning of the health, in
    flight; before it, the link is needed."""
    advice = tuple(advice)
    found = "; ".join(filter(None, [words, *(a.what for a in advice)]))
    needed = fails or any(a.severity is Severity.ERROR for a in advice)
    return Finding(name, found, tuple(a.remedy for a in advice if a.remedy), needed, bool(advice))


def _missing(config: Config, health: Health) -> set[str]:
    """The lines on which something that is needed is missing, whether advice was due already or not."""
    wants = needs(config)
    autopilots = {link.name for link in wants.links if link.is_autopilot}
    found = {
        "links": any(health.links[name].error for name in health.links),
        "autopilot": bool(autopilots) and not health.followed,
        "rates": bool(_slow(health)),
        "camera": wants.images and not health.cameras,
    }
    return {name for name, is_missing in found.items() if is_missing}


def _links(health: Health) -> str:
    return ", ".join(f"{name} {link.received} received" for name, link in health.links.items()) or "none"


def _slow(health: Health) -> list[str]:
    """Streams that come too seldom, or not at all."""
    return [
        name
        for name, hz in health.needed.items()
        if name not in health.streams or health.streams[name].rate < RATE_SHARE * hz
    ]


def _rates(health: Health) -> str:
    streams = health.streams
    rates = ((name, streams[name].rate if name in streams else 0.0, hz) for name, hz in health.needed.items())
    return ", ".join(f"{name} {rate:.0f} of {hz:.0f} Hz" for name, rate, hz in rates)


def _cameras(config: Config, health: Health) -> str:
    seen = ", ".join(f"{name} {camera.rate:.0f} Hz" for name, camera in health.cameras.items())
    return seen or ("no image" if needs(config).images else "")


def _offset(health: Health) -> str:
    if health.round_trip is None:
        return "" if health.clock_offset_ns is None else f"the autopilot's by {health.clock_source}"
    return f"the autopilot's by {health.clock_source}, round trip {1e3 * health.round_trip:.1f} ms"


def _disk(config: Config) -> Finding:
    """Room to record."""
    path = config.recorder.path
    if path is None:
        return Finding("disk", "nothing is recorded", ("set `path` of [recorder]",), is_doubt=True)
    wanted = Path(path).absolute().parent
    # The recorder makes the rest, but hardly means to below the root of the file system.
    folder = next(each for each in (wanted, *wanted.parents) if each.exists() or str(each.parent) == each.root)
    try:
        free = shutil.disk_usage(folder).free
    except OSError as error:
        return Finding.fails("disk", f"{folder}: {error.strerror}", "make the folder, or set `path` of [recorder]")
    words = f"{free / 1e9:.1f} GB free for {path}"
    if free < MIN_STORAGE_BYTES:
        return Finding.fails("disk", words, "make room (`df -h`, `du -sh *`)")
    if not os.access(folder, os.W_OK):
        return Finding.fails(
            "disk", f"{folder} cannot be written to", "set `path` of [recorder], or its permissions"
        )
    return Finding.fine("disk", words)


def _clock(config: Config, wall_s: float) -> Finding:
    """This computer's clock, which signatures and certificates need."""
    if wall_s >= MIN_UNIX_TIME_S:
        return Finding.fine(
            "clock", f"this computer's is {time.strftime('%Y-%m-%d %H:%M UTC', time.gmtime(wall_s))}"
        )
    signed = any(link.key_file for link in config.link) or config.zenoh.ca_file is not None
    words = f"this computer's is not set: {time.strftime('%Y-%m-%d', time.gmtime(wall_s))}"
    if signed:
        return Finding.fails(
            "clock", words, "set it (`timedatectl`): signatures and certificates are refused else"
        )
    return Finding("clock", words, is_doubt=True)


def _running(config: Config) -> Health | None:
    """The health of a daemon of this configuration that runs on this computer, None if none answers."""
    if not config.zenoh.enabled:
        return None
    for endpoint in config.zenoh.listens() or (DEFAULT_ENDPOINT,):
        with suppress(SinkError):
            client = Client(endpoint, config.zenoh.vehicle, config.zenoh)
            try:
                return _first_health(client)
            finally:
                client.close()
    return None


def _first_health(client: Client) -> Health | None:
    end = time.monotonic() + ANSWER_TIMEOUT_S
    while time.monotonic() < end:
        received = client.take(0.2)
        if received is not None and isinstance(received.record, Health):
            return received.record
    return None


async def listen(config: Config, wait_s: float) -> Health | None:
    """Be the daemon for at most `wait_s`, until nothing is missing; its last health, None if its links were not
    open by then. Raises UserError for what cannot be opened."""
    newest: list[Health] = []
    complete = asyncio.Event()

    def on_health(health: Health) -> None:
        newest[:] = [health]
        if health.uptime >= SETTLING_TIME_S and not _missing(config, health) and not health.advice:
            complete.set()

    daemon = Daemon(_quiet(config), report=lambda _: None, on_health=on_health)
    flight, waiting = asyncio.ensure_future(daemon.run(())), asyncio.ensure_future(complete.wait())
    await asyncio.wait({flight, waiting}, timeout=wait_s, return_when=asyncio.FIRST_COMPLETED)
    waiting.cancel()
    if flight.done():
        flight.result()
    flight.cancel()
    with suppress(asyncio.CancelledError):
        await flight
    return newest[0] if newest else None


def _quiet(config: Config) -> Config:
    """A configuration that sends nothing on which a vehicle flies, and writes no file."""
    return replace(
        config,
        leader_out=(),
        traffic_out=TrafficOutConfig(),
        odometry=OdometryConfig(),
        recorder=RecorderConfig(),
        parameters=ParametersConfig(),
        warm_start=WarmStartConfig(enabled=False),
    )

"""`python -m benchmarks.flooded [CASE ...] [--json FILE]`: a leader's estimates during a flood.

The flight of `benchmarks.live` continues while another process floods the same port and the same Zenoh listener.
For each case it prints: the images with a valid estimate, a second; their latency at the subscriber (ms); the sent
flood; the rejected data, by counter; and each line that the daemon reported, with its count. The case `none` is
the same without a flood, for comparison.
"""

import argparse
import json
import os
import re
import secrets
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Mapping
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from typing import Final

import psutil

from benchmarks.live import FLIGHT, TIMEOUT_S, Daemon, Figures, Subscriber, daemon, percentiles, program
from onboard.messages import Health

SETTLING_TIME_S: Final = 5  # of the flight before the flood
TAIL_TIME_S: Final = 2  # of the flight after the flood
ALL: Final = {
    "imu": 10_000,
    "adsb": 10_000,
    "param_set": 200,
    "param_list": 50,
    "garbage": 1_000,
    "unsigned": 200,
    "points": 500,
}
CASES: Final[Mapping[str, Mapping[str, int]]] = {
    "none": {},
    "adsb-10000": {"adsb": 10_000},
    "imu-10000": {"imu": 10_000},
    "imu-20000": {"imu": 20_000},
    "all": ALL,
    "all-signed": ALL,  # on a link with a key, which whoever floods it holds, but for two
    "strangers": {kind: rate for kind, rate in ALL.items() if kind != "points"},  # likewise, without the key
}
SIGNED: Final = ("all-signed", "strangers")


def measure_flood(case: str, seconds: int) -> Figures:
    """Return the figures of one case, with a flood of `seconds`."""
    key = secrets.token_hex(32) if case in SIGNED else ""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        link = ""
        if key:
            (folder / "key").write_text(key)
            (folder / "key").chmod(0o600)
            link = f", key_file='{folder / 'key'}'"
        settings = ("estimator.traffic={}", f"parameters.path='{folder / 'parameters.toml'}'")
        one = stack.enter_context(daemon(link=link, more=settings))
        one.wait_for("link autopilot")
        subscriber = stack.enter_context(closing(Subscriber(one.endpoint)))
        begin_ns = time.monotonic_ns() + 3_000_000_000
        where = ("--udp", str(one.udp), "--zenoh", one.endpoint, "--begin-ns", str(begin_ns))
        total = SETTLING_TIME_S + seconds + TAIL_TIME_S
        flight = program(FLIGHT, *where, "--seconds", str(total), "--origin", "--key", key)
        time.sleep((begin_ns - time.monotonic_ns()) * 1e-9 + SETTLING_TIME_S)
        cpu, since = one.cpu_s(), time.monotonic()
        sent = _flood(CASES[case], key if case != "strangers" else "", seconds, where)
        share = 100 * (one.cpu_s() - cpu) / (time.monotonic() - since)
        out, _ = flight.communicate(timeout=TIMEOUT_S + seconds)
        health = subscriber.health()
        return {
            "case": case,
            **_image_figures(json.loads(out)["images"], subscriber, seconds),
            "cpu_percent": share,
            "memory_mb": one.process.memory_info().rss / 1e6,
            "sent": sent,
            "left_out": _rejected(health),
            "lines": _lines(one),
            "load_average": os.getloadavg()[0],
        }


def _flood(rates: Mapping[str, int], key: str, seconds: int, where: tuple[str, ...]) -> dict[str, int]:
    if not rates:
        time.sleep(seconds)
        return {}
    kinds = [text for kind, rate in rates.items() for text in ("--kind", f"{kind}={rate}")]
    flood = program("floods", *where, "--seconds", str(seconds), "--key", key, *kinds)
    with suppress(psutil.Error):
        psutil.Process(flood.pid).nice(0)
    out, _ = flood.communicate(timeout=TIMEOUT_S + seconds)
    sent: dict[str, int] = json.loads(out)
    return sent


def _image_figures(images: list[tuple[int, int, int]], subscriber: Subscriber, seconds: int) -> Figures:
    """Return how many images during the flood had an estimate, a valid one, and its latency."""
    during = images[SETTLING_TIME_S * 30 + 30 : (SETTLING_TIME_S + seconds) * 30]
    answered, valid = subscriber.arrivals(), subscriber.arrivals(valid=True)
    late = [valid[stamp] - sent for stamp, _, sent in during if stamp in valid]
    return {
        "images": len(during),
        "answered": sum(stamp in answered for stamp, _, _ in during),
        "valid_per_s": 30 * len(late) / len(during),
        "arrival_ms": percentiles(late) if late else None,
    }


def _rejected(health: Health) -> Figures:
    """Return the data that were not used, by the counters of the health."""
    links = {
        f"{name}.{what}": count
        for name, link in health.links.items()
        for what, count in (("shed", link.shed), ("dropped", link.dropped), ("errors", link.errors))
        if count
    }
    sinks = {
        f"{name}.{what}": count
        for name, sink in health.sinks.items()
        for what, count in (("dropped", sink.dropped), ("dropped_important", sink.dropped_important))
        if count
    }
    return {**links, **sinks, **{name: count for name, count in health.rejected.items() if count}}


def _lines(one: Daemon) -> dict[str, int]:
    """Count each line of the daemon's report, regardless of its numbers."""
    return dict(Counter(re.sub(r"\d+(\.\d+)?", "N", line.split("onboard: ")[-1]) for line in one.lines()))


def _raise_priority() -> None:
    """Take precedence over the flood, if allowed: autopilot, camera and subscriber are other computers."""
    with suppress(OSError):
        os.nice(-11)


def main(arguments: list[str] | None = None) -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.flooded", description="A leader in a flood.")
    parser.add_argument("cases", nargs="*", metavar="CASE", help=f"of {', '.join(CASES)}; all by default")
    parser.add_argument("--seconds", type=int, default=20, help="of each flood (%(default)s)")
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    options = parser.parse_args(arguments)
    if unknown := set(options.cases) - set(CASES):
        parser.error(f"no such case: {', '.join(sorted(unknown))}")
    _raise_priority()
    found = []
    for case in options.cases or CASES:
        found.append(measure_flood(case, options.seconds))
        print(json.dumps(found[-1], indent=1), flush=True)
    if options.json is not None:
        options.json.write_text(json.dumps(found), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())

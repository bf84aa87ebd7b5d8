"""The load of the daemon with both estimators, with one of them, and with none.

    python -m benchmarks.both [--seconds N] [--rounds N]

The flight is simlink's `mission`, sent in real time by another process; this one subscribes and measures latency
from arrival. It prints a line of JSON for each run; shares are percent of one core.
"""

import argparse
import json
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from typing import Any, Final

import psutil

from benchmarks.live import TIMEOUT_S, Subscriber, free_port, percentiles, wait_until
from onboard.config import load_config
from onboard.messages import Exposure
from onboard.pipeline import Pipeline
from onboard.wire.logs.tlog import read_tlog

SETTLING_TIME_S: Final = 8  # of a flight, before measuring
START_DELAY_NS: Final = 50_000_000  # after the datagrams are made
ROOT: Final = Path(__file__).parents[1]
LEADER: Final = "leader={size_prior_m=2.667,leader_class='multirotor',center_on_wing=true}"
OWN_STATE: Final = "own_state={airframe='csvsf'}"
RUNS: Final = {"both": f"{LEADER},{OWN_STATE}", "leader": LEADER, "own_state": OWN_STATE, "none": ""}


def fly(log: Path, udp: int) -> None:
    """Send a flight in real time; print when each image was sent, by its stamp."""
    pipeline = Pipeline(load_config(None, ("estimator={}",)))
    sent: list[tuple[int, int]] = []
    flight = [
        (datagram, [m.t_ns for m in pipeline.decode(datagram) if isinstance(m, Exposure)])
        for datagram, _ in read_tlog(log.read_bytes())
        if datagram is not None
    ]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as to:
        to.connect(("127.0.0.1", udp))
        begin_ns = time.monotonic_ns() - flight[0][0].t_recv_ns + START_DELAY_NS
        for datagram, stamps in flight:
            time.sleep(max(0.0, (begin_ns + datagram.t_recv_ns - time.monotonic_ns()) * 1e-9))
            sent.extend((stamp, time.monotonic_ns()) for stamp in stamps)
            with suppress(OSError):
                to.send(datagram.data)
    print(json.dumps(sent))


def measure(name: str, log: Path, seconds: int) -> dict[str, Any]:
    """Measure one run with these estimators."""
    udp, endpoint = free_port(socket.SOCK_DGRAM), f"tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        settings = (
            f"estimator={{{RUNS[name]}}}",
            f"link=[{{name='autopilot',url='udpin:127.0.0.1:{udp}'}}]",
            f"zenoh.listen=['{endpoint}']",
            f"recorder.path='{folder / 'flight.mcap'}'",
        )
        command = [sys.executable, "-m", "onboard", "run", str(ROOT / "configs" / "demo.toml")]
        lines = stack.enter_context((folder / "log").open("wb"))
        popen = subprocess.Popen([*command, *(a for s in settings for a in ("--set", s))], stderr=lines)  # noqa: S603 - our own
        stack.callback(popen.wait, TIMEOUT_S)
        stack.callback(popen.terminate)
        wait_until(lambda: "link autopilot" in (folder / "log").read_text(errors="replace"), "a link", popen)
        daemon = psutil.Process(popen.pid)
        subscriber = stack.enter_context(closing(Subscriber(endpoint)))
        flight = [sys.executable, "-m", "benchmarks.both", "--fly", str(log), str(udp)]
        load = subprocess.Popen(flight, stdout=subprocess.PIPE, text=True)  # noqa: S603 - our own
        time.sleep(SETTLING_TIME_S)
        before, since = sum(daemon.cpu_times()[:2]), time.monotonic()
        out, _ = load.communicate(timeout=TIMEOUT_S + seconds)
        share = 100.0 * (sum(daemon.cpu_times()[:2]) - before) / (time.monotonic() - since)
        found = {"estimators": name, "cpu_percent": share, "memory_mb": daemon.memory_info().rss / 1e6}
        arrivals = subscriber.arrivals()
    delays = [arrivals[stamp] - at for stamp, at in json.loads(out)[SETTLING_TIME_S * 30 :] if stamp in arrivals]
    return found | ({"arrival_ms": percentiles(delays)} if delays else {})


def main(arguments: list[str] | None = None) -> int:
    """Measure all four sets of estimators, or fly."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.both", description="Both estimators, and each alone."
    )
    parser.add_argument("--seconds", type=int, default=40, help="of each flight")
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--fly", nargs=2, metavar=("LOG", "PORT"), help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.fly:
        fly(Path(options.fly[0]), int(options.fly[1]))
        return 0
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "mission.tlog"
        simlink = [sys.executable, "-m", "simlink", "log", "mission", "--out", str(log)]
        subprocess.run([*simlink, "--duration", str(options.seconds)], check=True)  # noqa: S603 - our own
        for name in list(RUNS) * options.rounds:
            print(json.dumps(measure(name, log, options.seconds)), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())

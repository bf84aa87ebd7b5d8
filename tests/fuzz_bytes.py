"""Coverage-guided fuzzing of all that reads bytes from outside: MAVLink, JSON documents over Zenoh, logs,
recordings and the configuration. None may raise anything but its own errors, and MAVLink must be read as pymavlink
reads it.

    make fuzz ARGS="--seconds 600"                  # every target for a share of the time; corpora in out/fuzz
    python -m tests.fuzz_bytes mavlink --file FILE  # one input again

With atheris (`pip install atheris`) the fuzzer sees which lines an input reaches. Each target is a process of its
own, since libFuzzer ends its process. Without atheris there is only `run`: a given number of random mutations.
"""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from tests.support.programs import ROOT

CORPUS: Final = ROOT / "out" / "fuzz"
RECV: Final = 1_735_689_605_000_000_000
LONGEST: Final = 4096  # bytes of an input
MEMORY: Final = next((d for d in ("/dev/shm",) if Path(d).is_dir()), None)  # noqa: S108 - faster than a disk


class DifferenceError(AssertionError):
    """Our decoder reads other than pymavlink."""


def mavlink(data: bytes) -> None:
    """One datagram, and the same bytes as a stream cut in three."""
    from onboard.wire.mavlink.decode import MavlinkDecoder  # noqa: PLC0415 - instrumented, so imported later
    from tests.support.pymavlink_reference import Reference  # noqa: PLC0415

    cuts = (data[: len(data) // 3], data[len(data) // 3 : len(data) // 2], data[len(data) // 2 :])
    for pieces, stream in (((data,), False), (cuts, True)):
        ours, reference = MavlinkDecoder(stream=stream), Reference(stream=stream)
        for piece in pieces:
            ours.decode(piece, RECV)
            reference.decode(piece, RECV)
        # Behind a wrong length it skips what we find at the next byte: no less than it reads, and no more than it
        # reads of some piece by itself.
        most = _whole_frames(data)
        if not reference.names <= ours.names <= most or (not reference.rejected and ours.names != reference.names):
            raise DifferenceError(f"{reference.names} <= {ours.names} <= {most}, {reference.rejected}")


def _whole_frames(data: bytes) -> Counter[str]:
    """Names of what pymavlink reads from any byte on, each by itself."""
    from tests.support.pymavlink_reference import Reference  # noqa: PLC0415 - as above

    names: Counter[str] = Counter()
    for at, start in enumerate(data[:-1]):
        if start in (0xFD, 0xFE):
            overhead = 8 if start == 0xFE else 12 + 13 * (data[at + 2 : at + 3] == b"\x01")
            reference = Reference(stream=False)
            reference.decode(data[at : at + data[at + 1] + overhead], RECV)
            if not reference.rejected:
                names += reference.names
    return names


def documents(data: bytes) -> None:
    """Every kind of document, by way of the decoder of datagrams, which counts what is bad and raises nothing."""
    from onboard.messages import Datagram  # noqa: PLC0415
    from onboard.wire.datagrams import DOCUMENTS, DatagramDecoder  # noqa: PLC0415

    decoder = DatagramDecoder()
    for encoding in DOCUMENTS:
        for message in decoder.decode(Datagram(channel="c", encoding=encoding, t_recv_ns=RECV, data=data)):
            msgspec.json.encode(message)


def logs(data: bytes) -> None:
    """A .tlog, and a recording of ours."""
    from onboard.wire.logs.recording import read_recording  # noqa: PLC0415
    from onboard.wire.logs.tlog import NotALogError, read_tlog  # noqa: PLC0415

    with tempfile.NamedTemporaryFile(dir=MEMORY) as file:
        file.write(data)
        file.flush()
        for reading in (lambda: read_tlog(data), lambda: read_recording(Path(file.name))):
            try:
                for _ in reading():
                    pass
            except NotALogError:
                continue


def configuration(data: bytes) -> None:
    """A configuration file."""
    from onboard import UserError  # noqa: PLC0415
    from onboard.config import load_config  # noqa: PLC0415

    with tempfile.NamedTemporaryFile(suffix=".toml", dir=MEMORY) as file:
        file.write(data)
        file.flush()
        try:
            load_config(Path(file.name), ())
        except UserError:
            return


TARGETS: Final[dict[str, Callable[[bytes], None]]] = {
    "mavlink": mavlink,
    "documents": documents,
    "logs": logs,
    "configuration": configuration,
}


def seeds(name: str) -> list[bytes]:
    """Good inputs to begin with."""
    from benchmarks.targets import flight  # noqa: PLC0415
    from onboard.wire.logs.tlog import tlog_record  # noqa: PLC0415
    from tests.support.mavlink_frames import NED_V1, NED_V2  # noqa: PLC0415

    flown = flight(1, 1)
    frames = [d.data for d in flown if d.encoding == "mavlink"][:20]
    if name == "mavlink":
        return [*frames, bytes.fromhex(NED_V1), bytes.fromhex(NED_V2), b"".join(frames[:5])]
    if name == "documents":
        points = [d.data for d in flown if d.encoding == "points"][:2]
        echo = b'{"range":1,"azimuth":0,"elevation":0}'
        radar = b'{"t_ns":1,"clock":"boot","radar":"nose","frame":"ned","detections":[' + echo + b"]}"
        return [*points, radar, b'{"t_ns":1,"clock":"boot","peer":2,"satellites":[]}']
    if name == "logs":
        return [b"".join(tlog_record(RECV, f) for f in frames[:3]), b"\x89MCAP0\r\n" + bytes(64)]
    return [path.read_bytes() for path in sorted((ROOT / "configs").glob("*.toml"))]


def mutated(rng: np.random.Generator, seed: bytes) -> bytes:
    """A few bytes changed, a stretch taken out or doubled, or two joined."""
    data = bytearray(seed)
    for _ in range(int(rng.integers(1, 6))):
        at, end = sorted(rng.integers(0, len(data) + 1, 2).tolist())
        kind = int(rng.integers(0, 4))
        if kind == 0 and data:
            data[int(rng.integers(0, len(data)))] = int(rng.integers(0, 256))
        elif kind == 1:
            del data[at : min(end, at + 8)]
        elif kind == 2:
            data[at:at] = data[at : min(end, at + 64)]
        else:
            data[at:at] = rng.bytes(int(rng.integers(1, 5)))
    return bytes(data[:LONGEST])


def run(name: str, seed: int, count: int) -> None:
    """`count` mutations of the seeds, without guidance. Raises whatever the target raises."""
    rng = np.random.default_rng([seed, sorted(TARGETS).index(name)])
    known = seeds(name)
    for _ in range(count):
        TARGETS[name](mutated(rng, known[int(rng.integers(0, len(known)))]))


def guided(name: str, seconds: int) -> None:
    """libFuzzer, by the lines that are reached. Does not return."""
    import atheris  # noqa: PLC0415 - does not install everywhere

    with atheris.instrument_imports(include=["onboard.wire", "onboard.config"]):
        import onboard.config  # noqa: PLC0415
        import onboard.wire.datagrams  # noqa: PLC0415
        import onboard.wire.logs.recording  # noqa: PLC0415, F401

    folder = CORPUS / name
    folder.mkdir(parents=True, exist_ok=True)
    for i, data in enumerate(seeds(name)):
        (folder / f"seed-{i}").write_bytes(data)
    options = [f"-max_total_time={seconds}", f"-max_len={LONGEST}", "-rss_limit_mb=2048", "-print_final_stats=1"]
    atheris.Setup([sys.argv[0], str(folder), *options, f"-artifact_prefix={CORPUS}/"], TARGETS[name])
    atheris.Fuzz()


def all_guided(seconds: int) -> int:
    """Every target in a process of its own; prints what each has reached. 1 if one has failed."""
    failed = 0
    for name in TARGETS:
        command = [sys.executable, "-m", "tests.fuzz_bytes", name, "--seconds", str(seconds // len(TARGETS))]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, env=dict(os.environ))
        executions = re.search(r"stat::number_of_executed_units:\s*(\d+)", done.stderr)
        reached = re.findall(r"cov: (\d+) ft: (\d+)", done.stderr)
        counts: dict[str, Any] = {
            "target": name,
            "executions": int(executions[1]) if executions else 0,
            "edges": int(reached[-1][0]) if reached else 0,
            "features": int(reached[-1][1]) if reached else 0,
            "exit": done.returncode,
        }
        print(json.dumps(counts), flush=True)
        if done.returncode:
            failed = 1
            print(done.stderr[-3000:], file=sys.stderr)
    return failed


def main() -> int:
    """Fuzz all targets or one, or run one input again."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz_bytes")
    parser.add_argument("target", nargs="?", choices=sorted(TARGETS), help="all by default")
    parser.add_argument("--seconds", type=int, default=60)
    parser.add_argument("--file", type=Path, help="run this input once")
    options = parser.parse_args()
    if options.target is None:
        return all_guided(options.seconds)
    if options.file is not None:
        TARGETS[options.target](options.file.read_bytes())
        return 0
    guided(options.target, options.seconds)
    return 0


if __name__ == "__main__":
    sys.exit(main())

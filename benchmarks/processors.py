"""The cost of machine code for a family of processors over that for this processor.

`python -m benchmarks.processors PYTHON` takes the interpreter of an installation with machine code (`make wheel`).
It replays simlink's mission with each estimator, alternately with the wheel's code and with code that Numba
compiles for this processor, and compares computing time and output bytes. It prints a line of JSON for each.
"""

import hashlib
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.both import RUNS

PAIR_COUNT: Final = 5
REPLAY: Final = """
import sys, time
import msgspec
from onboard.config import load_config
from onboard.pipeline import Pipeline
from onboard.wire.logs.tlog import read_tlog
from pathlib import Path

log, out, *settings = sys.argv[1:]
datagrams = [datagram for datagram, _ in read_tlog(Path(log).read_bytes()) if datagram is not None]
for times in range(2):  # the first warms up
    pipeline = Pipeline(load_config(None, tuple(settings)))
    began = time.process_time()
    outputs = [output for datagram in datagrams for output in pipeline.feed(datagram)]
    spent = time.process_time() - began
Path(out).write_bytes(b"".join(msgspec.json.encode(output) for output in outputs))
print(spent)
"""


def measure(name: str, python: Path, folder: Path) -> dict[str, Any]:
    """Measure one estimator with the wheel's code and with this processor's own.

    Returns the medians in seconds, the quartiles of the ratio over the pairs, and whether the outputs have the
    same bytes.
    """
    kept = {key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "NUMBA_"))}
    kept["WINGLINE_PRECISION"] = "double"  # as in flight
    call = [str(python.absolute()), "-c", "import llvmlite.binding as llvm; print(llvm.get_host_cpu_name())"]
    processor = subprocess.run(call, env=kept, check=True, text=True, stdout=subprocess.PIPE).stdout.strip()  # noqa: S603
    own = kept | {"NUMBA_CPU_NAME": processor, "NUMBA_CACHE_DIR": str(folder / "cache")}
    sides = {"wheel": kept, "own": own}
    spent: dict[str, list[float]] = {side: [] for side in sides}
    digests: set[str] = set()
    for _ in range(PAIR_COUNT + 1):
        for side, environment in sides.items():
            out = folder / "outputs"
            settings = (str(folder / "flight.tlog"), str(out), f"estimator={{{RUNS[name]}}}")
            command = [str(python.absolute()), "-P", "-c", REPLAY, *settings]
            done = subprocess.run(command, env=environment, check=True, text=True, stdout=subprocess.PIPE)  # noqa: S603
            spent[side].append(float(done.stdout))
            digests.add(hashlib.sha256(out.read_bytes()).hexdigest())
    wheel, here = (np.array(spent[side][1:]) for side in sides)  # the first pair compiles
    ratio = [round(float(q), 3) for q in np.quantile(wheel / here, [0.25, 0.5, 0.75])]
    figures = {"wheel_s": round(float(np.median(wheel)), 3), "own_s": round(float(np.median(here)), 3)}
    return {"estimator": name, **figures, "ratio": ratio, "same_bytes": len(digests) == 1}


def main(python: Path) -> None:
    """Print the lines."""
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "flight.tlog"
        flight = ["log", "mission", "--seed", "1", "--duration", "20", "--out", str(log)]
        subprocess.run([sys.executable, "-m", "simlink", *flight], check=True)  # noqa: S603 - our own
        for name in ("leader", "own_state"):
            print(json.dumps(measure(name, python, Path(folder))), flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))

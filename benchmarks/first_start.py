"""The first start of an installation: `python -m benchmarks.first_start PYTHON`.

PYTHON is the interpreter of an environment in which wingline is installed, as `make release` makes one. The daemon
has an empty home, and a simulated flight sends data from before its start. The time is from the start of the
process to its first estimate of the leader.
"""

import json
import os
import subprocess
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final

from benchmarks import live
from benchmarks.live import Daemon

SIZE: Final = """
import json, sys
from importlib import metadata
from pathlib import Path
own = [Path(str(f.locate())) for f in metadata.files("wingline")]
size = lambda paths: sum(p.stat().st_size for p in paths if p.is_file() and p.suffix != ".pyc")
code = [p for p in own if "machine_code" in p.parts]
everything = Path(sys.prefix).rglob("*")
print(json.dumps({"installed_mb": size(everything) / 1e6, "own_mb": size(own) / 1e6, "code_mb": size(code) / 1e6}))
"""


class Installed(Daemon):
    """A daemon of another environment."""

    python: str = sys.executable

    def _command(self, *settings: Any) -> list[str]:
        return [self.python, "-P", *super()._command(*settings)[1:]]


def measure(python: Path) -> dict[str, Any]:
    """Measure the seconds to the first estimate at two starts, and the installation's sizes."""
    Installed.python = str(python.absolute())
    kept = {key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "WINGLINE_", "XDG_"))}
    call = [Installed.python, "-P", "-c", SIZE]
    done = subprocess.run(call, capture_output=True, check=True, text=True, env=kept)  # noqa: S603 - our own code
    found: dict[str, Any] = json.loads(done.stdout)
    with ExitStack() as stack:
        kept["HOME"] = stack.enter_context(tempfile.TemporaryDirectory())
        for name in ("first_start_s", "second_start_s"):
            found[name] = live.start_in(kept, Installed)
    return found | {"machine": live.machine()}


if __name__ == "__main__":
    print(json.dumps(measure(Path(sys.argv[1])), indent=1))

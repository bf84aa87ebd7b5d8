"""The contents of an installation, written as a table into docs/installed.md.

Sizes are those of this computer's installed files, without bytecode. "In flight" says whether a running daemon of
configs/companion.toml, on an absent serial port, has loaded a module of a distribution.
"""

import json
import platform
import re
import subprocess
import sys
from collections.abc import Iterable
from importlib import metadata
from pathlib import Path
from typing import Final, NamedTuple

PAGE: Final = Path(__file__).parent / "installed.md"
ROOT: Final = PAGE.parents[1]
BEGIN, END = "<!-- sizes: begin (docs/sizes.py writes this) -->", "<!-- sizes: end -->"
PROJECT: Final = "wingline"
NAME: Final = re.compile(r"[\w.-]+")
LOADED: Final = """
import asyncio, json, sys
from pathlib import Path
from onboard.config import load_config
from onboard.daemon import Daemon

SETTINGS = "link=[{name='autopilot', url='serial:/dev/none:57600'}]", "zenoh.listen=['tcp/127.0.0.1:0']"

async def fly():
    running = asyncio.Event()
    config = load_config(Path("configs/companion.toml"), (*SETTINGS, "warm_start.enabled=false"))
    daemon = Daemon(config, report=lambda line: None, on_health=lambda health: running.set())
    tasks = [asyncio.ensure_future(it) for it in (daemon.run(()), running.wait())]
    await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    assert running.is_set()

asyncio.run(fly())
print(json.dumps(sorted({name.partition(".")[0] for name in sys.modules})))
"""


class Size(NamedTuple):
    """A distribution: version, size in bytes, the distributions that require it, and use in flight."""

    name: str
    version: str
    size: int
    required_by: tuple[str, ...]
    in_flight: bool


def normalise(name: str) -> str:
    """Return the normalised name of a distribution."""
    return re.sub(r"[-_.]+", "-", name).lower()


def requirements(name: str) -> list[str]:
    """Return the installed requirements of a distribution, without extras."""
    lines = [line for line in metadata.requires(name) or () if "extra ==" not in line]
    found = (NAME.match(line) for line in lines)
    return sorted({normalise(match[0]) for match in found if match is not None and is_installed(match[0])})


def is_installed(name: str) -> bool:
    """Whether a distribution is installed; one for other systems or Pythons is not."""
    try:
        metadata.distribution(name)
    except metadata.PackageNotFoundError:
        return False
    return True


def closure() -> dict[str, tuple[str, ...]]:
    """Return every distribution that the project needs, with those that require it."""
    found: dict[str, set[str]] = {}
    waiting = [PROJECT]
    while waiting:
        name = waiting.pop()
        for needed in requirements(name):
            if needed not in found:
                waiting.append(needed)
            found.setdefault(needed, set()).add(name)
    return {name: tuple(sorted(by)) for name, by in found.items()}


def loaded_distributions() -> set[str]:
    """Return the distributions of which a daemon has loaded a module."""
    call = [sys.executable, "-c", LOADED]
    done = subprocess.run(call, cwd=ROOT, capture_output=True, text=True, check=True)  # noqa: S603 - our own code
    owners = metadata.packages_distributions()
    tops: list[str] = json.loads(done.stdout.splitlines()[-1])
    return {normalise(owner) for top in tops for owner in owners.get(top, ())}


def sizes() -> list[Size]:
    """Return all distributions, the largest first."""
    loaded = loaded_distributions()
    found = []
    for name, by in closure().items():
        distribution = metadata.distribution(name)
        paths = (Path(str(file.locate())) for file in distribution.files or ())
        size = sum(p.stat().st_size for p in paths if p.exists() and p.suffix != ".pyc")
        found.append(Size(name, distribution.version, size, by, name in loaded))
    return sorted(found, key=lambda one: (-round(one.size, -5), one.name))


def table(found: Iterable[Size]) -> str:
    """Return the table as Markdown, with a row of the sum."""
    rows = list(found)
    where = f"{platform.machine()}, Python {platform.python_version()}"
    lines = [f"Measured on {where}; MB are 1,000,000 bytes.", ""]
    lines += ["| package | version | MB | in flight | required by |", "|---|---|---|---|---|"]
    for one in rows:
        by = ", ".join("us" if name == PROJECT else name for name in one.required_by)
        flies = "yes" if one.in_flight else "no"
        lines.append(f"| {one.name} | {one.version} | {one.size / 1e6:.1f} | {flies} | {by} |")
    both = (sum(one.size for one in rows), sum(one.size for one in rows if one.in_flight))
    lines.append(f"| **sum** | | {both[0] / 1e6:.0f}, of which {both[1] / 1e6:.0f} in flight | | |")
    return "\n".join(lines)


def main() -> int:
    """Write the table."""
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    _, _, after = rest.partition(END)
    PAGE.write_text(f"{before}{BEGIN}\n{table(sizes())}\n{END}{after}", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())

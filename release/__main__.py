"""`make release`: all files of a release, in `dist`.

    wingline-0.2.0-cp311-none-manylinux_2_28_x86_64.whl   with machine code, for this Python and kind of computer
    wingline-0.2.0-py3-none-any.whl                       without, for all
    wingline-0.2.0.tar.gz                                 the sources of the latter
    wingline-0.2.0-cp311-x86_64.cdx.json                  what an installation of the first holds (CycloneDX)
    wingline-0.2.0-cp311-x86_64-licences.txt              and under which licences
    onboard.1, simlink.1                                  man pages; the wheels have them, too
    SHA256SUMS                                            `sha256sum --check SHA256SUMS`

Nothing is published, and nothing tagged. The wheel is installed into an environment of its own, with the pinned
packages, where `onboard` must start.
"""

import hashlib
import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Final

from onboard import __version__
from release import man, wheel

OUT: Final = Path("dist")
SUMS: Final = "SHA256SUMS"
NAME: Final = f"wingline-{__version__}"
UNKNOWN: Final = "not stated"
MAX_LICENCE_LENGTH: Final = 100  # some packages state the whole text of their licence


def main() -> int:
    """Make all files again. Raises CalledProcessError."""
    os.environ["COLUMNS"] = "100"  # of usages in the man pages
    for path in earlier_files(OUT):
        path.unlink()
    made = wheel.build_all(OUT.resolve())
    made += man.write(OUT)
    with tempfile.TemporaryDirectory() as folder:
        python = install(made[0], Path(folder) / "venv")
        say(f"installed: {output(python.parent / 'onboard', '--version').strip()}")
        bill = bill_of_materials(python)
    where = f"{NAME}-{wheel.tag()}-{platform.machine()}"
    for name, text in ((f"{where}.cdx.json", bill), (f"{where}-licences.txt", licences(json.loads(bill)))):
        made.append(OUT / name)
        made[-1].write_text(text, encoding="utf-8")
    (OUT / SUMS).write_text("".join(sums(made)), encoding="utf-8")
    for path in sorted([*made, OUT / SUMS]):
        say(f"{path.stat().st_size / 1e6:8.1f} MB  {OUT / path.name}")
    return 0


def earlier_files(out: Path) -> list[Path]:
    """Return the files of this version that an earlier run has made."""
    others = (out / name for name in ("onboard.1", "simlink.1", SUMS))
    return [*out.glob(f"{NAME}[-.]*"), *(path for path in others if path.exists())]


def install(made: Path, folder: Path) -> Path:
    """Return the interpreter of a new environment with a wheel and its pinned requirements only."""
    output(sys.executable, "-m", "venv", "--without-pip", str(folder))
    python = folder / "bin" / "python"
    pip = (sys.executable, "-m", "pip", "--python", str(python), "--disable-pip-version-check")
    output(*pip, "install", "-qq", "--no-compile", "-c", str(wheel.ROOT / "constraints.txt"), str(made))
    return python


def bill_of_materials(python: Path) -> str:
    """Return the bill of materials of an environment, in CycloneDX' JSON, checked against its schema."""
    tool = shutil.which("cyclonedx-py", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    if tool is None:
        raise FileNotFoundError("cyclonedx-py is missing: pip install '.[release]'")
    project = ("--pyproject", str(wheel.ROOT / "pyproject.toml"))
    return output(tool, "environment", *project, "--output-reproducible", "--of", "JSON", str(python))


def licences(bill: dict[str, Any]) -> str:
    """Return a line for each component of a bill of materials: its name, version and licence."""
    rows = [(c["name"], c["version"], " and ".join(licences_of(c)) or UNKNOWN) for c in bill["components"]]
    widths = [max(len(row[k]) for row in rows) for k in (0, 1)]
    return "".join(
        f"{n:{widths[0]}}  {v:{widths[1]}}  {k}\n" for n, v, k in sorted(rows, key=lambda r: r[0].lower())
    )


def licences_of(component: dict[str, Any]) -> Iterator[str]:
    """Yield the licences of a component: an expression, or identifiers, or else names."""
    stated = component.get("licenses", [])
    found = [one.get("expression") or one["license"].get("id") or one["license"]["name"] for one in stated]
    yield from sorted({name.rpartition(" :: ")[2] for name in found if len(name) < MAX_LICENCE_LENGTH})


def sums(paths: Iterable[Path]) -> Iterator[str]:
    """Yield the SHA-256 of files, in the format of sha256sum."""
    for path in sorted(paths):
        yield f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n"


def output(*command: str | Path) -> str:
    """Return the output of a program. Raises CalledProcessError."""
    return subprocess.run(command, check=True, text=True, stdout=subprocess.PIPE).stdout  # noqa: S603 - ours


def say(line: str) -> None:
    """Print a line."""
    print(line, flush=True)


if __name__ == "__main__":
    sys.exit(main())

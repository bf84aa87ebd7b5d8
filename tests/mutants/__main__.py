"""`python -m tests.mutants [NAME ...]`: does a test see each wrong line?

Every mutant is put into a copy of the tree, and the tests that are named for it run there, but for slow ones. It
is killed when one fails. The exit code is 1 when one survives that is not declared to, when one that is declared
is killed, and when the tests fail without any mutant. Names may hold wildcards; `--from NAME` goes on with a run
that was broken off.

Where the file has kernels, its tests run them in Python, so that no machine code of the right line can
run in place of the wrong one.

`--random N --seed S` draws mutants instead (`tests.mutants.drawn`). For those the kernels are compiled anew in
which the wrong line may be: the nearest tests are whole flights, too, and would take hours without the compiler.

`--matrix FILE` says which test files kill which of them (`tests.mutants.matrix`).
"""

import argparse
import fnmatch
import math
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue
from typing import Final, NamedTuple

from tests.mutants.drawn import draw, interval
from tests.mutants.matrix import STOPPED, TEST_LIMIT_S, fill, read_coverage, summary
from tests.mutants.observed import OBSERVED
from tests.mutants.table import ROOT, Mutant, MutantError, read

KILLED, ENDLESS, SURVIVED, BROKEN = "killed", "endless", "survived", "BROKEN"
UNDECIDED, EQUIVALENT = "not decided", "equivalent"  # of those drawn
WANTED: Final = 0.9  # share of those drawn and decided that tests kill
PARTS: Final = (
    "onboard",
    "simlink",
    "studies",
    "benchmarks",
    "release",
    "examples",
    "docs",
    "configs",
    "tests",
    "pyproject.toml",
)
LIMIT_S: Final = 600.0  # then it is taken to run for ever, and counts as killed
# pytest's exit code for failed tests, and ours for endless ones; 0 is success, any other: no tests were run
TESTS_FAILED, TOO_LONG = 1, -1
ALL: Final = ("-q", "-m", "not slow", "-rf", "--tb=line", "-p", "no:cacheprovider")
FIRST: Final = (*ALL, "-x", "--timeout=0")  # the limit of single tests would kill, on a busy computer, the unseen
MATRIX: Final = {
    compiled: (*ALL, f"--timeout={limit_s:g}", "-p", "tests.mutants.observed")
    for compiled, limit_s in TEST_LIMIT_S.items()
}
KERNEL: Final = "@kernel("  # stands in a file with kernels


class Ran(NamedTuple):
    """What became of a mutant; `output` is the end of what pytest printed."""

    mutant: Mutant
    outcome: str
    seconds: float
    output: str

    @property
    def as_declared(self) -> bool:
        """Whether it was killed, or survived with a reason."""
        return self.outcome in ((SURVIVED,) if self.mutant.survives else (KILLED, ENDLESS))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the mutants, print what became of each and a summary; the exit code."""
    options = _parser().parse_args(arguments)
    try:
        table = list(read().values())
        if options.matrix:
            return _run_matrix(draw(options.random or 0, options.seed, table, options.folders), options)
        if options.random:
            return _run_drawn(draw(options.random, options.seed, table), options)
        chosen = choose(table, options.names, options.start)
    except MutantError as error:
        print(error, file=sys.stderr)
        return 2
    if options.list:
        print("\n".join(mutant.name for mutant in chosen))
        return 0
    begin = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        copies = [_copy(Path(folder) / str(k)) for k in range(options.jobs)]
        if not options.unchecked and not _right_without(copies[0], chosen):
            return 2
        ran = _run_all(copies, chosen)
    return _summary(ran, time.monotonic() - begin)


def choose(mutants: Sequence[Mutant], patterns: Sequence[str], start: str | None) -> list[Mutant]:
    """Those whose names match a pattern (all, if there is none), from the one named `start` on. Raises
    MutantError where there are none."""
    names = [mutant.name for mutant in mutants]
    if start is not None and start not in names:
        raise MutantError(f"no mutant is named {start}")
    later = mutants[names.index(start) if start else 0 :]
    for pattern in patterns:
        if not fnmatch.filter(names, pattern):
            raise MutantError(f"no mutant is named {pattern}")
    return [m for m in later if not patterns or any(fnmatch.fnmatchcase(m.name, p) for p in patterns)]


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m tests.mutants", description="Does a test see each wrong line?"
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="mutants, with wildcards; all by default")
    parser.add_argument("--from", dest="start", metavar="NAME", help="go on with this one")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="how many at a time (%(default)s)")
    parser.add_argument("--unchecked", action="store_true", help="do not run the tests without a mutant first")
    parser.add_argument("--random", type=int, metavar="N", help="draw N changes of one token instead")
    parser.add_argument("--seed", type=int, default=1, help="other ones for each (%(default)s)")
    parser.add_argument(
        "--limit", type=float, default=150.0, metavar="S", help="time for a drawn one (%(default)g s)"
    )
    parser.add_argument("--matrix", type=Path, metavar="FILE", help="which tests kill which of those drawn")
    parser.add_argument("--in", dest="folders", nargs="+", default=[], metavar="FOLDER", help="draw from these")
    parser.add_argument("--tests", nargs="+", default=["tests"], metavar="PATH", help="tests of the matrix")
    parser.add_argument("--first", action="store_true", help="end each run with the first kill")
    parser.add_argument("--compiled", action="store_true", help="compile kernels anew, for the matrix")
    parser.add_argument("--coverage", type=Path, metavar="FILE", help="data of `pytest --cov-context=test`")
    parser.add_argument("--list", action="store_true", help="print the names and run nothing")
    return parser


def _copy(folder: Path) -> Path:
    """A copy of the tree with its machine code, whose stamps fit the sources' times."""
    for part in PARTS:
        source = ROOT / part
        if source.is_dir():
            shutil.copytree(source, folder / part, ignore=shutil.ignore_patterns("*.pyc"))
        else:
            shutil.copy2(source, folder / part)
    return folder


def _run_drawn(mutants: Sequence[Mutant], options: argparse.Namespace) -> int:
    """Run mutants that were drawn, one at a time; print each that no test sees, and the share of those killed."""
    outcomes: Counter[str] = Counter()
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        right = _copy(Path(folder) / "right")
        for k, mutant in enumerate(mutants, 1):
            wrong = shutil.copytree(right, Path(folder) / "wrong")  # machine code of the last one is not in it
            outcome, seconds = _run_one_drawn(wrong, mutant, options.limit)
            shutil.rmtree(wrong)
            outcomes[outcome] += 1
            print(f"{k:4}/{len(mutants)} {outcome:11} {seconds:6.1f} s {mutant.name}", flush=True)
    killed, decided = outcomes[KILLED], outcomes[KILLED] + outcomes[SURVIVED]
    low, high = interval(killed, decided)
    share = f"{100 * killed / max(decided, 1):.0f} % killed ({100 * low:.0f} to {100 * high:.0f})"
    print(f"\n{', '.join(f'{n} {outcome}' for outcome, n in outcomes.most_common())}: {share}")
    return 0 if killed >= WANTED * decided else 1


def _run_matrix(mutants: Sequence[Mutant], options: argparse.Namespace) -> int:
    """Run all tests that are asked for with each mutant, and print the summary."""
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        copy = _copy(Path(folder) / "copy") if mutants else Path(folder)

        def run(mutant: Mutant | None, tests: Sequence[str], compiled: bool) -> str:
            (copy / OBSERVED).unlink(missing_ok=True)
            if mutant is None:
                return _pytest(copy, tests, compiled=compiled, limit_s=math.inf, options=MATRIX[compiled])[1]
            wrong = mutant._replace(tests=tuple(tests))
            flags = (*MATRIX[compiled], *(["-x"] if options.first else []))
            return _run(copy, wrong, limit_s=options.limit, compiled=compiled, options=flags).output

        executed = read_coverage(options.coverage) if options.coverage else None
        fill(options.matrix, mutants, options.tests, copy, run, executed, is_compiled=options.compiled)
    print(summary([options.matrix]))
    return 0


def _run_one_drawn(copy: Path, mutant: Mutant, limit_s: float) -> tuple[str, float]:
    """What became of it, and after how long (s)."""
    if not mutant.tests:
        return SURVIVED, 0.0
    ran = _run(copy, mutant, limit_s=limit_s, compiled=True)
    outcome = ran.outcome
    if outcome == BROKEN:  # tests that cannot even be collected see it; where all are slow, none was asked
        outcome = UNDECIDED if "no tests ran" in ran.output or "deselected" in ran.output else KILLED
    elif outcome == ENDLESS:
        outcome = UNDECIDED  # it may be endless, or its tests take long
    elif outcome == SURVIVED and mutant.survives:
        outcome = EQUIVALENT
    return outcome, ran.seconds


def _right_without(copy: Path, mutants: Sequence[Mutant]) -> bool:
    """Whether all tests pass before anything is changed; the others say nothing."""
    for compiled in (True, False):
        tests = sorted({t for m in mutants if _is_compiled(copy, m) is compiled for t in m.tests})
        if not tests:
            continue
        print(f"without a mutant: {len(tests)} tests, {'compiled' if compiled else 'interpreted'}", flush=True)
        code, output = _pytest(copy, tests, compiled=compiled, limit_s=10 * LIMIT_S)
        if code != 0:
            print(f"{output}\nthey fail without any mutant", flush=True)
            return False
    return True


def _run_all(copies: Sequence[Path], mutants: Sequence[Mutant]) -> list[Ran]:
    """Each mutant in one of the copies; what became of each is printed when it is known, in the table's order."""
    free: SimpleQueue[Path] = SimpleQueue()
    for copy in copies:
        free.put(copy)

    def run_one(mutant: Mutant) -> Ran:
        copy = free.get()
        try:
            return _run(copy, mutant)
        finally:
            free.put(copy)

    ran = []
    width = max(len(mutant.name) for mutant in mutants)
    with ThreadPoolExecutor(len(copies)) as pool:
        for k, one in enumerate(pool.map(run_one, mutants), 1):
            ran.append(one)
            print(
                f"{k:4}/{len(mutants)} {one.mutant.name:{width}} {one.outcome:8} {one.seconds:6.1f} s", flush=True
            )
            if one.outcome == BROKEN:
                print(one.output, flush=True)
    return ran


def _run(
    copy: Path,
    mutant: Mutant,
    *,
    limit_s: float = LIMIT_S,
    compiled: bool | None = None,
    options: Sequence[str] = FIRST,
) -> Ran:
    """Change the copy, run the tests named, and put the copy right again, its times too."""
    path, begin = copy / mutant.file, time.monotonic()
    right, stamp = path.read_text(encoding="utf-8"), path.stat()
    if compiled is None:
        compiled = _is_compiled(copy, mutant)
    path.write_text(mutant.applied_to(right), encoding="utf-8")
    try:
        code, output = _pytest(copy, mutant.tests, compiled=compiled, limit_s=limit_s, options=options)
    finally:
        path.write_text(right, encoding="utf-8")
        os.utime(path, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
    outcome = {0: SURVIVED, TESTS_FAILED: KILLED, TOO_LONG: ENDLESS}.get(code, BROKEN)
    return Ran(mutant, outcome, time.monotonic() - begin, output)


def _is_compiled(copy: Path, mutant: Mutant) -> bool:
    """Whether its tests may use the compiler: no machine code is made of the file it changes."""
    return KERNEL not in (copy / mutant.file).read_text(encoding="utf-8")


def _pytest(
    copy: Path, tests: Sequence[str], *, compiled: bool, limit_s: float, options: Sequence[str] = FIRST
) -> tuple[int, str]:
    """Return pytest's exit code, or TOO_LONG, and the end of its output."""
    environment = os.environ | {
        "PYTHONPATH": str(copy),
        "PYTHONDONTWRITEBYTECODE": "1",  # a mutant of the same length in the same second must not leave its own
        "OMP_NUM_THREADS": "1",
        "WINGLINE_KERNELS": "machine" if compiled else "python",
        "HYPOTHESIS_STORAGE_DIRECTORY": str(copy / ".hypothesis"),
    }
    command = [sys.executable, "-m", "pytest", *options, *tests]
    with subprocess.Popen(
        command, cwd=copy, env=environment, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    ) as process:
        try:
            output, _ = process.communicate(timeout=None if math.isinf(limit_s) else limit_s)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            return TOO_LONG, f"{STOPPED} {limit_s:g} s"
    return process.returncode, output[-2000:]


def _summary(ran: Sequence[Ran], seconds: float) -> int:
    """Print how many were killed, and every one that is not as declared; the exit code."""
    killed = sum(one.outcome in (KILLED, ENDLESS) for one in ran)
    print(f"\n{killed} of {len(ran)} killed ({100 * killed / len(ran):.1f} %) in {seconds:.0f} s")
    for one in ran:
        if one.as_declared:
            reason = f": {one.mutant.survives}" if one.mutant.survives else ""
            if reason:
                print(f"  declared: {one.mutant.name}{reason}")
        else:
            print(f"  not as declared: {one.mutant.name} ({one.mutant.file}) {one.outcome}")
    return 0 if all(one.as_declared for one in ran) else 1


if __name__ == "__main__":
    sys.exit(main())

"""Which test file kills which mutant: `python -m tests.mutants --matrix FILE --in FOLDER --tests PATH ...`.

Mutants are drawn as with `--random` (`--random N --seed S`). The tests run once without any mutant, then all of
them with each. FILE gets one line of JSON a mutant, so that a run that was broken off goes on where it was;
without `--random` the summary of FILE is printed alone. Tests that are slow without a mutant are left out. With
`--first` a mutant's run ends with its first kill, cheap tests first: enough for the share that is killed.

Where the mutant's file has kernels, the tests run them in Python; with `--compiled`, they are compiled anew.
`--coverage FILE`, data of `pytest --cov --cov-context=test`, leaves out tests that do not execute the line.
"""

import json
import sqlite3
import sys
from collections import defaultdict
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from tests.mutants.observed import CHOSEN, OBSERVED
from tests.mutants.table import ROOT, Mutant

MODES: Final = {True: "machine", False: "python"}
TEST_LIMIT_S: Final = {True: 60.0, False: 15.0}  # of a single test, with machine code and in Python
MAX_SHARE_OF_LIMIT: Final = 0.4  # of a test without a mutant; more might not end in time on a busy computer
STOPPED: Final = "stopped after"  # pytest's output begins so where all tests together took too long
Run = Callable[[Mutant | None, Sequence[str], bool], str]  # a mutant, test files, compiled or not: pytest's output


class Executed(NamedTuple):
    """The tests that execute a line of a source, and those that execute any line of a source."""

    by_line: Mapping[tuple[str, int], Collection[str]]
    by_file: Mapping[str, Collection[str]]

    def tests(self, file: str, line: int) -> Collection[str] | None:
        """Those that may see a change of the line; of machine code those of its folder. None: nothing is known."""
        found = self.by_line.get((file, line)) or self.by_file.get(file)
        folder = file.rpartition("/")[0]
        near = (tests for other, tests in self.by_file.items() if other.startswith(folder))
        return found or set[str]().union(*near) or None


def read_coverage(path: Path) -> Executed:
    """Read a data file of coverage.py, whose contexts are names of tests."""
    by_line, by_file = defaultdict(set), defaultdict(set)
    with sqlite3.connect(path) as data:
        query = (
            "SELECT file.path, context.context, numbits FROM line_bits "
            "JOIN file ON file.id = file_id JOIN context ON context.id = context_id"
        )
        for source, context, bits in data.execute(query):
            name, test = "onboard/" + source.rpartition("/onboard/")[2], context.rpartition("|")[0]
            by_file[name] |= {test} - {""}
            for k, byte in enumerate(bits):
                for bit in range(8):
                    if byte >> bit & 1:
                        by_line[name, 8 * k + bit].add(test)
    # a line that is executed as it is imported concerns all tests of its file
    return Executed({key: tests for key, tests in by_line.items() if "" not in tests}, by_file)


def fill(
    path: Path,
    mutants: Sequence[Mutant],
    tests: Sequence[str],
    copy: Path,
    run: Run,
    executed: Executed | None,
    *,
    is_compiled: bool = False,
) -> None:
    """Run each mutant that has no line in the file yet, and add its line."""
    lines, baselines = read_matrix(path)
    done = {line["mutant"] for line in lines}
    for k, mutant in enumerate(mutants, 1):
        if mutant.name in done:
            continue
        compiled = is_compiled or "@kernel(" not in (ROOT / mutant.file).read_text(encoding="utf-8")
        if MODES[compiled] not in baselines:
            (copy / CHOSEN).unlink(missing_ok=True)
            output = run(None, tests, compiled)
            baselines[MODES[compiled]] = passed = _passed(
                copy / OBSERVED, MAX_SHARE_OF_LIMIT * TEST_LIMIT_S[compiled]
            )
            _add(path, {"mode": MODES[compiled], "passed": passed})
            print(f"without a mutant, {MODES[compiled]}: {len(passed)} tests pass\n{output[-300:]}", flush=True)
        usual = baselines[MODES[compiled]]
        line = int(mutant.name.partition(" ")[0].rpartition(":")[2])
        may_see = executed.tests(mutant.file, line) if executed else None
        chosen = [
            test for test in sorted(usual, key=lambda test: usual[test]) if may_see is None or test in may_see
        ]
        (copy / CHOSEN).write_text("\n".join(chosen), encoding="utf-8")
        output = run(mutant, sorted({_file(test) for test in chosen}), compiled) if chosen else ""
        ended = not output.startswith(STOPPED)  # otherwise the last test is not endless, only not over
        killers = _killers(copy / OBSERVED, usual, {"failed", "begun"} if ended else {"failed"}) if chosen else []
        if chosen and not (copy / OBSERVED).exists():  # not even the tests' own set-up ran
            killers = sorted({_file(test) for test in chosen})
        _add(path, {"mutant": mutant.name, "ran": len(chosen), "killers": killers, "survives": mutant.survives})
        print(f"{k:4}/{len(mutants)} {len(killers):4} of {len(chosen):4} kill {mutant.name}", flush=True)


def read_matrix(path: Path) -> tuple[list[dict[str, Any]], dict[str, dict[str, float]]]:
    """Return the lines of mutants, and the seconds of each test without a mutant, by mode."""
    entries = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()] if path.exists() else []
    return (
        [entry for entry in entries if "mutant" in entry],
        {entry["mode"]: entry["passed"] for entry in entries if "mode" in entry},
    )


def summary(paths: Sequence[Path]) -> str:
    """Kills, seconds and lines of each file, a cover of all kills, and the mutants that none kills."""
    kills, seconds, alive, number = defaultdict(set), defaultdict(float), [], 0
    for path in paths:
        lines, baselines = read_matrix(path)
        for test, duration in {**baselines.get("python", {}), **baselines.get("machine", {})}.items():
            seconds[_file(test)] += duration
        for line in lines:
            number += not line["survives"]
            for killer in line["killers"]:
                kills[_file(killer)].add(line["mutant"])
            if not line["killers"] and not line["survives"]:
                alive.append(line["mutant"])
    by_kills = sorted(seconds, key=lambda file: (-len(kills[file]), file))
    only = {f: kills[f] - set().union(*(kills[g] for g in seconds if g != f)) for f in seconds}
    rows = [f"{len(kills[f]):5} {len(only[f]):5} {seconds[f]:7.1f} {_size(f):5} {f}" for f in by_kills]
    chosen = cover(kills, seconds)
    parts = [
        "kills alone seconds lines file",
        *rows,
        f"\na cover of all kills, {sum(seconds[f] for f in chosen):.1f} s, {sum(map(_size, chosen))} lines:",
        *chosen,
        f"\nnot in it, {sum(map(_size, set(seconds) - set(chosen)))} lines:",
        *sorted(set(seconds) - set(chosen)),
        f"\n{number - len(alive)} of {number} killed; alive:",
        *alive,
    ]
    return "\n".join(parts)


def cover(kills: Mapping[str, set[str]], seconds: Mapping[str, float]) -> list[str]:
    """Choose files that together kill all that is killed: each time the most new kills for the seconds."""
    left, chosen = set().union(*kills.values()), []
    while left:
        best = max(kills, key=lambda file: (len(kills[file] & left) / (1.0 + seconds.get(file, 0.0)), file))
        chosen.append(best)
        left -= kills[best]
    return chosen


def _passed(observed: Path, limit_s: float) -> dict[str, float]:
    """Return the seconds of each test that passed in time."""
    seconds, bad = defaultdict(float), set()
    for test, outcome, duration in _observed(observed):
        seconds[test] += duration
        if outcome in {"failed", "skipped"}:
            bad.add(test)
    return {test: round(s, 2) for test, s in seconds.items() if test not in bad and s <= limit_s}


def _killers(observed: Path, usual: Mapping[str, float], bad: Collection[str]) -> list[str]:
    """The tests that failed or did not end, and the files that could not be imported."""
    state: dict[str, str] = {}
    for test, outcome, _ in _observed(observed):
        if state.get(test) != "failed":
            state[test] = outcome
    files = {_file(test) for test in usual}
    return sorted(test for test, outcome in state.items() if outcome in bad and _file(test) in files)


def _observed(path: Path) -> list[tuple[str, str, float]]:
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()] if path.exists() else []


def _add(path: Path, entry: Mapping[str, object]) -> None:
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(entry) + "\n")


def _file(test: str) -> str:
    return test.partition("::")[0]


def _size(file: str) -> int:
    path = ROOT / file
    return len(path.read_text(encoding="utf-8").splitlines()) if path.exists() else 0


if __name__ == "__main__":
    print(summary([Path(name) for name in sys.argv[1:]]))

"""The matrix of mutants against tests: which tests run, who killed, and what a cover is."""

import json
from pathlib import Path

from tests.mutants.matrix import Executed, cover, fill, read_matrix, summary
from tests.mutants.observed import OBSERVED
from tests.mutants.table import Mutant

OTHER, SAME = "tests/unit/a.py", "tests/unit/b.py"
WRONG = Mutant("onboard/units.py:3 a -> b", "onboard/units.py", "a", "b", ("t",))


def test_a_line_is_of_those_that_execute_it_and_an_imported_one_of_all_of_its_file() -> None:
    executed = Executed({("x/y.py", 3): {"a"}}, {"x/y.py": {"a", "b"}})
    assert [executed.tests("x/y.py", 3), executed.tests("x/y.py", 4)] == [{"a"}, {"a", "b"}]
    assert executed.tests("x/kernel.py", 3) == {"a", "b"}
    assert executed.tests("z/kernel.py", 3) is None


def test_the_matrix_counts_the_failed_and_the_endless_and_goes_on_where_it_was(tmp_path: Path) -> None:
    runs, file = [], tmp_path / "matrix"

    def run(mutant: Mutant | None, tests: list[str], compiled: bool) -> str:
        runs.append(tests)
        assert compiled
        ends = [("::1", "passed"), ("::2", "passed"), ("::3", "skipped")]
        if mutant:
            ends = [("::1", "passed"), ("::1", "failed")]  # the second is its teardown
        lines = [[OTHER + name, outcome, 0.1] for name, outcome in ends]
        lines += (
            [[SAME + "::4", "begun", 0.0]] if mutant else [[SAME + "::4", "passed", 30.0], [SAME, "passed", 1]]
        )
        (tmp_path / OBSERVED).write_text("\n".join(map(json.dumps, lines)), encoding="utf-8")
        return ""

    for _ in range(2):
        fill(file, [WRONG], ["tests"], tmp_path, run, None)
    (line,), baselines = read_matrix(file)
    assert runs == [["tests"], [OTHER, SAME]]
    assert sorted(baselines["machine"]) == [OTHER + "::1", OTHER + "::2", SAME]  # not the skipped, not the slow
    assert line["killers"] == [OTHER + "::1", SAME + "::4"]
    assert "1 of 1 killed" in summary([file])


def test_a_cover_takes_what_kills_most_for_its_seconds() -> None:
    kills = {"dear": {"1", "2", "3"}, "cheap": {"1", "2"}, "same": {"2"}, "useless": set()}
    assert cover(kills, {"dear": 10.0, "cheap": 0.1}) == ["cheap", "dear"]

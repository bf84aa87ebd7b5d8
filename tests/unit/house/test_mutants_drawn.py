"""Mutants that are drawn: which changes there are of a source, which tests are near, and what a share says."""

import ast
import subprocess
from pathlib import Path

import pytest

from tests.mutants import drawn
from tests.mutants.changes import changes
from tests.mutants.drawn import draw, interval, nearest
from tests.mutants.table import ROOT, read
from tests.near import changed, near

TABLE = list(read().values())


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("a <= b", ["a < b"]),
        ("é = a < b", ["é = a <= b"]),  # a column of `ast` counts bytes
        ("a is not b", ["a is b"]),
        ("a not in b", ["a in b"]),
        ("(a) - (b)", ["(a) + (b)"]),
        ("a += b", ["a -= b"]),
        ("a and not b", ["a and b", "a or not b"]),
        ("x = 1", ["x = 0", "x = 2"]),
        ("x = 2.5", ["x = 5.0"]),
        ("x = -a", ["x = +a"]),
        ("x = True", ["x = False"]),
        ("x = np.minimum(a, b)", ["x = np.maximum(a, b)"]),
        ("def f():\n    if a:\n        return b", ["def f():\n    if False:\n        return b"]),
        ("def f(a: Literal[1] | None) -> int: ...", []),
        ("x: Final[int | None] = None", []),
        ("Pair = tuple[1, 2]", []),
        ("isinstance(a, B | C)", []),
        ('"%s" % a', []),
        ("@a(1)\nclass B(C[1], frozen=True): ...", []),
        ("f(a=1 if b else c)", ["f(a=0 if b else c)", "f(a=2 if b else c)"]),
    ],
)
def test_the_changes_of_a_line(text: str, wrong: list[str]) -> None:
    assert sorted(change.applied_to(text) for change in changes(text)) == sorted(wrong)


def test_lines_of_all_packages_are_drawn() -> None:
    packages = {path.relative_to(ROOT).parts[0] for path in drawn._sources()}
    assert packages == {"onboard", "simlink", "studies"}


def test_a_draw_is_the_same_for_the_same_seed_and_each_is_a_program(monkeypatch: pytest.MonkeyPatch) -> None:
    few = drawn._sources()[::7]  # to find the changes of all sources takes eight seconds
    monkeypatch.setattr(drawn, "_sources", lambda: few)
    mutants = draw(12, 1, TABLE)
    assert mutants == draw(12, 1, TABLE)
    assert len({m.name for m in mutants}) == 12
    assert {m.name for m in mutants} != {m.name for m in draw(12, 2, TABLE)}
    for mutant in mutants:
        wrong = mutant.applied_to((ROOT / mutant.file).read_text(encoding="utf-8"))
        ast.parse(wrong)
        (line,) = [b for a, b in zip(mutant.old.splitlines(), wrong.splitlines(), strict=True) if a != b]
        assert mutant.name.endswith(line.strip())


def test_tests_are_near_that_are_named_for_a_file_or_import_it() -> None:
    tests = nearest("onboard/wire/logs/tlog.py", TABLE)
    assert tests[0] == "tests/unit/wire/test_tlog.py"
    assert len(tests) <= drawn.MOST_FILES
    assert all(Path(ROOT / test).exists() for test in tests)
    assert nearest("onboard/nothing.py", TABLE) == ()


def test_what_is_near_a_change_is_a_test_itself_or_reaches_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    test = "tests/unit/wire/test_radar.py"
    found = near(["onboard/wire/logs/tlog.py", "tests/support/dataflash.py", test, "README.md"], TABLE)
    assert {"tests/unit/wire/test_tlog.py", "tests/unit/commands/test_flight_folder.py", test} <= set(found)
    assert found == sorted(set(found))
    for command in (
        ["init", "-q"],
        ["add", "."],
        ["-c", "user.name=a", "-c", "user.email=a", "commit", "-qm", "a"],
    ):
        for name in ("same.py", "changed.py", "gone.py"):
            (tmp_path / name).touch()
        subprocess.run(["git", *command], cwd=tmp_path, check=True)
    (tmp_path / "changed.py").write_text("1")
    (tmp_path / "new.py").touch()
    (tmp_path / "gone.py").unlink()
    monkeypatch.setattr("tests.near.ROOT", tmp_path)
    assert changed() == ["changed.py", "new.py"]


def test_a_share_is_known_as_well_as_its_number_allows() -> None:
    assert interval(41, 50) == pytest.approx((0.692, 0.902), abs=1e-3)  # Newcombe 1998, method 3
    assert interval(0, 0) == (0.0, 1.0)
    low, high = interval(10, 10)
    assert low == pytest.approx(0.722, abs=1e-3)
    assert high == pytest.approx(1.0)

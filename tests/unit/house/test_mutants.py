"""The table of mutants fits the sources: each can still be made, and its tests are there. `make mutants` runs
them."""

import ast
from functools import cache
from pathlib import Path

import pytest

from tests.mutants.__main__ import PARTS, choose
from tests.mutants.table import ROOT, Mutant, MutantError, read
from tests.support.tables import each

MUTANTS = read()


@cache
def text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


@cache
def names_in(path: Path) -> set[str]:
    """The test functions of a file."""
    return {
        node.name for node in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(node, ast.FunctionDef)
    }


@each("mutant", MUTANTS)
def test_a_mutant_can_be_made_and_its_tests_are_there(mutant: Mutant) -> None:
    assert mutant.file.partition("/")[0] in PARTS  # of the copy in which its tests run
    text = text_of(ROOT / mutant.file)
    wrong = mutant.applied_to(text)
    ast.parse(wrong)  # what is no Python is seen by every test
    for test in mutant.tests:
        file, _, name = test.partition("::")
        assert name.partition("[")[0] in {"", *names_in(ROOT / file)}, test


def test_there_are_a_hundred_at_least() -> None:
    assert len(MUTANTS) >= 100


def test_an_old_text_that_is_gone_or_not_unique_is_refused() -> None:
    mutant = Mutant("flip", "x.py", "a + b", "a - b", ("tests/x.py",))
    assert mutant.applied_to("c = a + b") == "c = a - b"
    for text in ("c = a - b", "c = a + b + a + b"):
        with pytest.raises(MutantError, match="not once"):
            mutant.applied_to(text)


def test_mutants_are_chosen_by_name_and_from_one_on() -> None:
    mutants = [Mutant(name, "x.py", "a", "b", ("t",)) for name in ("a-1", "b-1", "b-2")]
    assert [m.name for m in choose(mutants, [], None)] == ["a-1", "b-1", "b-2"]
    assert [m.name for m in choose(mutants, ["b-*"], None)] == ["b-1", "b-2"]
    assert [m.name for m in choose(mutants, [], "b-1")] == ["b-1", "b-2"]
    for patterns, start in ((["c"], None), ([], "c")):
        with pytest.raises(MutantError, match="no mutant is named c"):
            choose(mutants, patterns, start)

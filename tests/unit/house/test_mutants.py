"""The table of mutants fits the sources: each can still be made, and its tests are there. `make mutants` runs
them."""

import ast
from functools import cache
from pathlib import Path

from tests.mutants.__main__ import PARTS
from tests.mutants.table import ROOT, Mutant, read
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

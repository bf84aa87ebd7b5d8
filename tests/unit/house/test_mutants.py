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


@cache
def statements(path: Path) -> list[tuple[int, int]]:
    """First and last lines of a file's statements; a decorator is part of its function."""
    body = ast.parse(text_of(path)).body
    lines = [min([n.lineno, *(d.lineno for d in getattr(n, "decorator_list", []))]) for n in body]
    return list(zip(lines, [line - 1 for line in lines[1:]] + [len(text_of(path).splitlines())], strict=True))


def statement(path: Path, line: int) -> tuple[int, int]:
    """The lines of the statement that has a line, with what follows up to the next."""
    return next((span for span in reversed(statements(path)) if span[0] <= line), (1, line))


@each("mutant", MUTANTS)
def test_a_mutant_can_be_made_and_its_tests_are_there(mutant: Mutant) -> None:
    assert mutant.file.partition("/")[0] in PARTS  # of the copy in which its tests run
    text = text_of(ROOT / mutant.file)
    wrong = mutant.applied_to(text)
    first, last = statement(ROOT / mutant.file, text.count("\n", 0, text.index(mutant.old)) + 1)
    changed = wrong.count("\n") - text.count("\n")
    ast.parse("\n".join(wrong.splitlines()[first - 1 : last + changed]))  # every test sees what is no Python
    for test in mutant.tests:
        file, _, name = test.partition("::")
        assert name.partition("[")[0] in {"", *names_in(ROOT / file)}, test

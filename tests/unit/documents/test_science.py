"""The papers' tables in docs/science.md: every row leads to code and to a test; no equation is left out."""

import ast
import re
from collections.abc import Iterator
from functools import cache

import pytest

from tests.support import documents
from tests.support.programs import ROOT

EQUATIONS = {
    "Oh & Johnson: relative motion from vision": [f"{i}" for i in range(1, 55)],
    "Al-Shabi, Gadsden & Wilkerson: the cubature smooth variable structure filter": [
        *(f"2.1.{i}" for i in range(1, 8)),
        *(f"2.2.{i}" for i in range(1, 13)),
        *(f"2.3.{i}" for i in range(1, 7)),
        *("3.1", "4.1", "4.2"),
    ],
    "De Vivo et al.: Joseph's form for the square-root unscented filter": [f"{i}" for i in range(1, 54)],
    "Varaprasad et al.: tracking a launch vehicle": [f"{i}" for i in range(1, 21)],
    "Lazarov et al.: a linear tracker": [f"{i}" for i in range(1, 20)],
}


def rows(heading: str) -> list[list[str]]:
    """The rows of a paper's table: what it is in the paper, its content, code, test."""
    (table,) = documents.tables(documents.section("science", heading))
    return table


def places(cell: str) -> list[tuple[str, str]]:
    """The files and the names in them, each a pair, of a cell of paths and names in backticks."""
    found: list[tuple[str, str]] = []
    path, used = "", True
    for token in [*re.findall(r"`([^`]+)`", cell), "/"]:
        if "/" in token:
            assert used, f"{path}: nothing in it is named"
            path, used = token, False
        else:
            assert path, f"{token}: in which file?"
            found.append((path, token))
            used = True
    assert found, f"{cell}: names no code"
    return found


@cache
def defined(path: str) -> set[str]:
    """What a file's top level defines: functions, classes, constants."""
    names: set[str] = set()
    for node in ast.parse((ROOT / path).read_text(encoding="utf-8")).body:
        match node:
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
                names.add(name)
            case ast.AnnAssign(target=ast.Name(id=name)):
                names.add(name)
            case ast.Assign(targets=targets):
                names |= {target.id for target in targets if isinstance(target, ast.Name)}
    return names


def equations(cell: str) -> Iterator[str]:
    """The numbers of equations in a first cell: `1, 3–5` is 1, 3, 4, 5. Figures and tables are none."""
    numbers, *_ = re.split(r"figure|table|appendix|section", cell)
    for part in filter(None, (p.strip() for p in numbers.split(","))):
        first, _, last = part.partition("–")
        chapter, _, number = first.rpartition(".")
        for i in range(int(number), int((last or first).rpartition(".")[2]) + 1):
            yield f"{chapter}.{i}" if chapter else f"{i}"


@pytest.mark.parametrize("heading", EQUATIONS)
def test_every_row_names_code_that_is_there(heading: str) -> None:
    missing = [(path, name) for row in rows(heading) for path, name in places(row[2]) if name not in defined(path)]
    assert missing == []


@pytest.mark.parametrize("heading", EQUATIONS)
def test_every_row_names_a_test_that_is_there(heading: str) -> None:
    named = [place for row in rows(heading) for place in places(row[3])]
    assert [place for place in named if place[1] not in defined(place[0])] == []
    assert all(path.startswith("tests/") and name.startswith("test_") for path, name in named)


@pytest.mark.parametrize("heading", EQUATIONS)
def test_every_equation_of_the_paper_is_in_one_row(heading: str) -> None:
    found = [number for row in rows(heading) for number in equations(row[0])]
    assert sorted(found) == sorted(EQUATIONS[heading])

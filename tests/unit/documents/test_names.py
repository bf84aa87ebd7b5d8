"""Words in backticks, in pages, docstrings and comments, name something that exists: a module, a function, a key,
an attribute, a file. Names of other programs are listed."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.support import documents
from tests.support.programs import ROOT
from tests.unit.documents.test_configuration import exists

PROGRAMS = ("onboard", "simlink", "studies")
SOURCES = (*PROGRAMS, "benchmarks", "tests", "examples", "docs", "release")
SETTINGS = ("configs/*", "simlink/scenarios/*.toml", "pyproject.toml", "Makefile", "Containerfile", "compose.yaml")
NAME = re.compile(r"`([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*)(?:\(\))?`")
WORD = re.compile(r"[A-Za-z_]\w*")
COMMENT = re.compile(r"(^|\s)#.*")
FOREIGN = {  # of other programs: what they call their own
    *("AC_PosControl", "PositionControl"),  # files and classes of autopilots
    *("rmw_zenoh", "apriltag_ros", "image_rect", "calibrateCamera"),  # of ROS and OpenCV
    *("LimitNICE", "maxconn"),  # systemd, HAProxy
}
PARAMETER = re.compile(r"(AP|EK3|FLW|FOLL|LTEST|PLND|RTL|SIH|WPNAV)_[A-Z_]+")  # of an autopilot
FILES = {"cpp", "csv", "json", "jsonl", "mcap", "md", "parm", "py", "rrd", "toml", "tum"}  # and their suffixes
OTHERS = {"numba", "numpy", "zenoh"}  # packages whose names modules of ours have, too
COUNTED = ("leader.", "own_state.", "traffic.")  # counters of the health: what is counted, and its verdict
LIBRARIES = "## Coming from another library"  # below it, names of other libraries


@cache
def known() -> frozenset[str]:
    """Every word of the code that is not in a docstring or a comment, of settings, and of the names of files."""
    words: set[str] = set()
    for path in sources():
        words |= read(path).words | {*WORD.findall(str(path.relative_to(ROOT)))}
    for pattern in SETTINGS:
        for path in ROOT.glob(pattern):
            words |= {*WORD.findall(path.name)}
            words |= {*WORD.findall(path.read_text(encoding="utf-8"))} if path.is_file() else set()
    return frozenset(words)


@cache
def sources() -> tuple[Path, ...]:
    return tuple(path for folder in SOURCES for path in sorted((ROOT / folder).rglob("*.py")))


@cache
def modules() -> dict[str, list[Path]]:
    """Our modules by each end of their dotted names, as `filters.kalman` and `kalman`, with their files."""
    found: dict[str, list[Path]] = {}
    for path in sources():
        parts = path.relative_to(ROOT).with_suffix("").parts
        parts = parts[:-1] if parts[-1] == "__init__" else parts
        for k in range(len(parts)):
            found.setdefault(".".join(parts[k:]), []).append(path)
    return found


class Source(NamedTuple):
    """The words of a source's code, what stands there behind a dot or is a field of a record, and its docstrings
    and comments."""

    words: frozenset[str]
    attributes: frozenset[str]
    prose: str


@cache
def read(path: Path) -> Source:
    text = path.read_text(encoding="utf-8")
    lines, prose, attributes = text.splitlines(), list[str](), set[str]()
    for node in ast.walk(ast.parse(text)):
        match node:
            case ast.Expr(value=ast.Constant(value=str(docstring)) as string):  # that stands by itself
                end = string.end_lineno or string.lineno
                lines[string.lineno - 1 : end] = [""] * (end - string.lineno + 1)
                prose.append(docstring)
            case ast.Attribute(attr=name) | ast.AnnAssign(target=ast.Name(id=name)):
                attributes.add(name)
    prose += [comment[0] for line in lines if (comment := COMMENT.search(line))]
    code = "\n".join(COMMENT.sub("", line) for line in lines)
    return Source(frozenset(WORD.findall(code)), frozenset(attributes), "\n".join(prose))


def stale(text: str) -> list[str]:
    """The names in backticks that name nothing."""
    return [name for name in dict.fromkeys(NAME.findall(text)) if not is_known(name)]


def is_known(name: str) -> bool:
    """Whether each part of a name is a word of ours, and the part behind a module is in that module."""
    words = name.split(".")
    if FOREIGN & {*words} or PARAMETER.fullmatch(name) or name in modules() or exists(name):
        return True
    if name.startswith(COUNTED):
        words = [words[0], *name.split(".", 1)[1].split("_")]
        return {*words} <= known()
    if not all(map(is_word, words)):
        return False
    if words[-1] in FILES or words[0] in OTHERS:
        return True
    for k in range(len(words) - 1, 0, -1):
        if files := modules().get(".".join(words[:k])):
            elsewhere = attributes() | {*modules()}
            return words[k] in elsewhere or any(words[k] in read(path).words for path in inside(files))
    return True


@cache
def attributes() -> frozenset[str]:
    """What stands behind a dot in our code, or is a field of a record: of a module's name it may be one, too."""
    return frozenset().union(*(read(path).attributes for path in sources()))


def is_word(word: str) -> bool:
    """Whether there is a word, or one that has it, where `_` begins it: `r_north`, `_east`."""
    if word.startswith("_"):
        return word in known() or any(word.rstrip("_") in other for other in known())
    return word in known()


def inside(files: list[Path]) -> Iterator[Path]:
    """These files, and those of the folders that they stand for."""
    for path in files:
        yield path
        if path.name == "__init__.py":
            yield from path.parent.rglob("*.py")


@pytest.mark.parametrize("path", documents.ALL, ids=documents.name)
def test_words_in_backticks_on_a_page_name_something(path: Path) -> None:
    text, _, _ = documents.text(path).partition(LIBRARIES)
    assert stale(re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)) == []


def test_words_in_backticks_in_the_code_name_something() -> None:
    found = {
        str(path.relative_to(ROOT)): names
        for package in PROGRAMS
        for path in sorted((ROOT / package).rglob("*.py"))
        if (names := stale(read(path).prose))
    }
    assert found == {}

"""Words in backticks, in pages, docstrings and comments, name something that exists: a module, a function, a key,
an attribute, a file. Names of other programs are listed."""

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from tests.support import documents
from tests.support.programs import ROOT
from tests.unit.documents.test_configuration import exists

PROGRAMS = ("onboard", "simlink", "studies")
SOURCES = (*PROGRAMS, "benchmarks", "tests", "examples", "docs", "release")
SETTINGS = ("configs/*", "simlink/scenarios/*.toml", "pyproject.toml", "Makefile", "Containerfile", "compose.yaml")
NAME = re.compile(r"`([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*)(?:\(\))?`")
WORD = re.compile(r"[A-Za-z_]\w*")
FOREIGN = {  # of other programs: what they call their own
    *("mode_follow", "AP_Follow", "TargetEstimator", "FlightTaskAutoFollowTarget"),
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
        words |= words_of(path) | {*WORD.findall(str(path.relative_to(ROOT)))}
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


@cache
def code_of(path: Path) -> str:
    """A source without its docstrings and comments."""
    text = path.read_text(encoding="utf-8")
    lines = text.splitlines()
    for node in docstrings(text):
        lines[node.lineno - 1 : node.end_lineno] = [""] * ((node.end_lineno or node.lineno) - node.lineno + 1)
    return "\n".join(re.sub(r"(^|\s)#.*", "", line) for line in lines)


def prose_of(path: Path) -> str:
    """The docstrings and comments of a source."""
    text = path.read_text(encoding="utf-8")
    comments = [
        token.string
        for token in tokenize.generate_tokens(io.StringIO(text).readline)
        if token.type == tokenize.COMMENT
    ]
    return "\n".join([*(str(node.value) for node in docstrings(text)), *comments])


def docstrings(text: str) -> Iterator[ast.Constant]:
    """The strings of a source that stand by themselves."""
    for node in ast.walk(ast.parse(text)):
        if (
            isinstance(node, ast.Expr)
            and isinstance(node.value, ast.Constant)
            and isinstance(node.value.value, str)
        ):
            yield node.value


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
            return words[k] in elsewhere or any(words[k] in words_of(path) for path in inside(files))
    return True


@cache
def words_of(path: Path) -> frozenset[str]:
    return frozenset(WORD.findall(code_of(path)))


@cache
def attributes() -> frozenset[str]:
    """What stands behind a dot in our code, or is a field of a record: of a module's name it may be one, too."""
    found: set[str] = set()
    for path in sources():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Attribute):
                found.add(node.attr)
            elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                found.add(node.target.id)
    return frozenset(found)


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
        if (names := stale(prose_of(path)))
    }
    assert found == {}


def test_a_stale_name_is_found() -> None:
    update, word = "filters.kalman." + "no_such_" + "update", "no_such_" + "word"
    assert stale(f"`kalman.predict` `filters.kalman.update` `{update}` `{word}`") == [update, word]

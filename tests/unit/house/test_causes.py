"""Programs compare causes; sentences are for people. Whoever words a reason names its cause."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from onboard.health.words import WORDS
from onboard.messages import DOUBT_CAUSES, Cause, Severity, Verdict
from tests.support.programs import ROOT

PROSE = {"reason", "reasons", "words", "error", "what", "text"}  # attributes that hold sentences
DECIDES = (*(ROOT / "onboard" / "pipeline").rglob("*.py"), *(ROOT / "onboard" / "autopilot").rglob("*.py"))
SOURCES = tuple((ROOT / "onboard").rglob("*.py"))
STRING_METHODS = {name for name in vars(str) if not name.startswith("_")} - {"format", "join"}


def readings(source: str) -> Iterator[str]:
    """What decides by a sentence: a comparison with one, or a search in one."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Compare):
            compared: list[ast.expr] = [node.left, *node.comparators]
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            compared = [node.func.value] if node.func.attr in STRING_METHODS else []
        else:
            compared = []
        if any(isinstance(part, ast.Attribute) and part.attr in PROSE for part in compared):
            yield ast.unparse(node)


def imports_of(source: str) -> set[str]:
    """The modules that are imported whole."""
    tree = ast.walk(ast.parse(source))
    return {alias.name for node in tree if isinstance(node, ast.Import) for alias in node.names}


@pytest.mark.parametrize("path", DECIDES, ids=lambda path: str(path.relative_to(ROOT)))
def test_health_and_autopilot_read_no_sentence(path: Path) -> None:
    source = path.read_text(encoding="utf-8")
    assert list(readings(source)) == []
    if "health" in path.parts or path.stem in ("silence", "notices", "reasons"):
        assert "re" not in imports_of(source)


def test_whoever_words_a_reason_names_its_cause_and_every_cause_is_named_by_somebody() -> None:
    named = set()
    for path in SOURCES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = {keyword.arg for keyword in node.keywords} if isinstance(node, ast.Call) else set()
            if "reason" in names:
                assert "cause" in names, f"{path}: {ast.unparse(node)}"
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "Cause":
                named.add(node.attr)
    assert {cause for cause in Cause if cause.name not in named} <= {Cause(v) for v in Verdict if v in list(Cause)}


def test_what_is_only_in_doubt_and_what_it_costs_is_known_by_its_cause() -> None:
    assert WORDS.keys() >= DOUBT_CAUSES
    costly = {cause for cause in DOUBT_CAUSES if WORDS[cause].refusal.severity is not Severity.NOTICE}
    assert costly == {Cause.MOUNT, Cause.OFF_CENTER}


def test_one_file_says_when_a_leader_is_lost() -> None:
    leader = ROOT / "onboard" / "estimators" / "leader"
    naming = {path.name for path in leader.rglob("*.py") if "LOST" in path.read_text(encoding="utf-8")}
    assert naming == {"life_cycle.py"}

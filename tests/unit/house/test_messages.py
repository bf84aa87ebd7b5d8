"""All messages to people, in one file to be read from top to bottom."""

import ast
import re
from argparse import ArgumentParser, _SubParsersAction
from collections.abc import Iterator
from pathlib import Path

from onboard.commands.cli import parser
from onboard.health.words import WORDS
from onboard.messages.causes import Cause
from tests.support.programs import ROOT

SEVERITIES = ("INFO", "NOTICE", "WARNING", "ERROR", "CRITICAL")


def messages() -> Iterator[str]:
    """Advice, causes, help of each command, and the literal texts of errors, reasons and STATUSTEXTs."""
    for cause, words in WORDS.items():
        texts = (words.refused, words.sensor, words.refusal.words, words.state.words)
        yield from (f"advice {cause}: {text}" for text in texts if text)
    yield from (f"cause {cause}: {cause.meaning}" for cause in Cause)
    yield from help_of(parser(), "onboard")
    for path in sorted((ROOT / "onboard").rglob("*.py")):
        name = path.relative_to(ROOT).as_posix()
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and re.search(r"(Error|Reason)$", ast.unparse(node.func)):
                yield from (f"{name}: {text}" for text in map(literal, node.args) if " " in text)
            elif isinstance(node, ast.Tuple) and node.elts and ast.unparse(node.elts[0]) in SEVERITIES:
                yield from (f"{name}: {text}" for text in map(literal, node.elts[1:]) if text)


def help_of(command: ArgumentParser, name: str) -> Iterator[str]:
    yield f"{name} --help: {command.description}"
    for action in command._actions:
        if isinstance(action, _SubParsersAction):
            for sub, of in action.choices.items():
                yield from help_of(of, f"{name} {sub}")
        elif action.help and action.dest != "help":
            yield f"{name} {action.dest}: {action.help}"


def literal(node: ast.expr) -> str:
    """The text of a string, with the expressions of an f-string in braces."""
    if isinstance(node, ast.JoinedStr):
        parts = (ast.unparse(p.value) if isinstance(p, ast.FormattedValue) else literal(p) for p in node.values)
        return "".join(map(str, parts))
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""


def test_a_message_has_at_most_two_sentences(tmp_path: Path) -> None:
    file = tmp_path / "messages.txt"
    texts = [*messages()]
    file.write_text("\n".join(texts))
    print(file)  # `pytest -s` shows where
    assert len(texts) > 700
    assert [text for text in texts if len(re.findall(r"[a-z`\])][.?!] +(?=[A-Z])", text)) > 1] == []

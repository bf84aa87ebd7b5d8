"""Commands in the documents: every call parses with today's parsers, and every target is in the Makefile."""

import argparse
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from onboard.autopilot.parameters import KEYS
from onboard.commands import cli
from simlink import cli as simlink_cli
from tests.support import documents
from tests.support.programs import ROOT

MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
TARGETS = set(re.findall(r"^([a-z-]+):", MAKEFILE, re.MULTILINE))
PARSERS = {"onboard": cli.parser, "simlink": simlink_cli.parser}


def subcommands(program: str) -> dict[str, argparse.ArgumentParser]:
    parser = PARSERS[program]()
    (action,) = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    return dict(action.choices)


def flags(program: str, command: str) -> set[str]:
    return {flag for action in subcommands(program)[command]._actions for flag in action.option_strings}


def calls_in_blocks(text: str) -> list[str]:
    """Lines of indented blocks, joined where they end with a backslash, without comments."""
    lines = re.findall(r"^    (\S.*)$", text.replace("\\\n", " "), re.MULTILINE)
    return [line.split(" #")[0] for line in lines if re.match(r"(onboard|simlink|make) [a-z]", line)]


def calls_in_text(text: str) -> list[str]:
    """Calls in backticks, which may be cut short and have placeholders."""
    return re.findall(r"`((?:onboard|simlink|make) [a-z][^`]*)`", text)


@pytest.mark.parametrize("path", documents.ALL, ids=documents.name)
def test_every_call_in_a_block_parses(path: Path) -> None:
    for call in calls_in_blocks(documents.text(path)):
        program, *arguments = shlex.split(call)
        if program == "make":
            assert arguments[0] in TARGETS, call
        else:
            PARSERS[program]().parse_args(arguments)


@pytest.mark.parametrize("path", documents.ALL, ids=documents.name)
def test_every_call_in_the_text_names_what_there_is(path: Path) -> None:
    for call in calls_in_text(documents.text(path)):
        program, command, *rest = call.split()
        if program == "make":
            assert command in TARGETS, call
        else:
            assert command in subcommands(program), call
            assert set(re.findall(r"--[a-z-]+", " ".join(rest))) <= flags(program, command), call


def test_the_table_of_commands_is_complete() -> None:
    table, targets, *_ = documents.tables(documents.text("commands"))
    named = [tuple(call.split()[:2]) for what, _ in table for call in calls_in_text(what)]
    assert set(named) == {(program, command) for program in PARSERS for command in subcommands(program)}
    assert {call.removeprefix("make ") for what, _ in targets for call in calls_in_text(what)} == TARGETS


def test_pre_commit_runs_what_lint_runs() -> None:
    recipe = re.search(r"^lint:.*\n((?:\t.*\n)+)", MAKEFILE, re.MULTILINE)
    assert recipe is not None
    hooks = re.findall(r"entry: \.venv/bin/(.*)", (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))
    assert hooks == re.findall(r"\$\(BIN\)/(.*)", recipe[1])


def test_module_and_command_are_one() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "onboard", "--version"], capture_output=True, text=True, cwd=ROOT, check=True
    )
    assert re.fullmatch(r"wingline \d+\.\d+\.\d+\n", done.stdout)


def test_the_page_has_every_parameter_and_its_key() -> None:
    (table,) = documents.tables(documents.section("commands", "Parameters"))
    shown = {documents.names(name)[0]: documents.names(key)[0] for name, key in table}
    assert shown == {name: key.rstrip(".012") for name, (key, _) in KEYS.items()}

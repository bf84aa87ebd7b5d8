"""What `make release` and `make wheel` write: man pages, licences, sums, and requirements that fit."""

import argparse
import shutil
import subprocess
from pathlib import Path

import pytest

import release.__main__ as release
from onboard import __version__
from onboard.commands import cli
from onboard.commands.completion import commands_of
from release import man, wheel
from simlink.cli import parser as simlink_parser

PARSERS = {"onboard": cli.parser, "simlink": simlink_parser}
REQUESTS = (".TH ", ".SH ", ".SS ", ".TP", ".PP", ".nf", ".fi")


@pytest.mark.parametrize("name", PARSERS)
def test_a_man_page_has_every_command_and_option(name: str) -> None:
    parser = PARSERS[name]()
    page = man.page(name, parser).replace(r"\-", "-")
    for command in commands_of(parser).values():
        assert f".SS {command.prog}" in page
        for action in command._actions:
            assert all(f"{flag}" in page for flag in action.option_strings)
    assert f"wingline {__version__}" in page.splitlines()[0]


@pytest.mark.parametrize("name", PARSERS)
def test_no_line_of_a_man_page_is_taken_for_a_request(name: str) -> None:
    """A help that begins with ".tlog, ArduPilot .bin" would not be shown."""
    lines = man.page(name, PARSERS[name]()).splitlines()
    assert all(line.startswith(REQUESTS) for line in lines if line[:1] in {".", "'"})
    assert man.text(".tlog\n'x' of C:\\logs") == "\\&.tlog\n\\&'x' of C:\\elogs"


@pytest.mark.skipif(shutil.which("man") is None, reason="man is not installed")
def test_man_shows_it_without_a_warning(tmp_path: Path) -> None:
    for path in man.write(tmp_path):
        shown = subprocess.run(
            ["man", "--warnings", "-l", path],
            capture_output=True,
            text=True,
            check=True,
            env={"PATH": "/usr/bin:/bin"},
        )
        assert shown.stderr == ""
        assert "--help" in shown.stdout


def test_what_is_hidden_is_not_in_a_man_page() -> None:
    parser = argparse.ArgumentParser(prog="p", description="A program.")
    parser.add_argument("--seen", help="100 %% of it")
    parser.add_argument("--unseen", help=argparse.SUPPRESS)
    page = man.page("simlink", parser)
    assert "100 % of it" in page
    assert "unseen" not in page


def test_the_licences_are_those_of_the_bill() -> None:
    components = [
        {"name": "b", "version": "1", "licenses": [{"expression": "MIT OR Apache-2.0"}]},
        {"name": "Alpha", "version": "2.10", "licenses": [{"license": {"id": "BSD-3-Clause"}}]},
        {"name": "c", "version": "3", "licenses": [{"license": {"name": "x" * 5000}}]},
        {
            "name": "d",
            "version": "4",
            "licenses": [{"license": {"id": "MIT"}}, {"license": {"name": "License :: Apache"}}],
        },
    ]
    assert release.licences({"components": components}).splitlines() == [
        "Alpha  2.10  BSD-3-Clause",
        "b      1     MIT OR Apache-2.0",
        "c      3     not stated",
        "d      4     Apache and MIT",
    ]


def test_a_copy_for_a_wheel_has_what_is_installed(tmp_path: Path) -> None:
    tree = wheel.copy_tree(tmp_path / "tree")
    assert (tree / "onboard" / "share" / "configs" / "companion.toml").is_file()
    assert not (tree / "onboard" / "share" / "configs").is_symlink()
    assert {path.name for path in (tree / "man").iterdir()} == {"onboard.1", "simlink.1"}
    assert not [*tree.rglob("__pycache__"), *tree.rglob("machine_code")]
    assert wheel.PAGES in (tree / "pyproject.toml").read_text()

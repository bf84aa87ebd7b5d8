"""The man pages of `onboard` and `simlink`, made from their argparse parsers.

argparse-manpage, the usual tool, leaves out examples, and lines that begin with a dot, as ".tlog, ArduPilot".
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from onboard import __version__
from onboard.commands import cli
from onboard.commands.completion import commands_of
from simlink.cli import parser as simlink_parser

STATUS: Final = {
    "onboard": "0: done. 1: it ran and failed. 2: the call, or a file, was at fault. 130: interrupted.",
    "simlink": "0: done. 1: a file could not be written. 2: the call was at fault. 130: interrupted.",
}


def write(folder: Path) -> list[Path]:
    """Write the pages into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, parser in (("onboard", cli.parser()), ("simlink", simlink_parser())):
        path = folder / f"{name}.1"
        path.write_text(page(name, parser), encoding="utf-8")
        written.append(path)
    return written


def page(name: str, parser: argparse.ArgumentParser) -> str:
    """Return a program's page, in the language of man(7)."""
    return "\n".join([*_head(name, parser), *_commands(parser), *_section("EXIT STATUS", STATUS[name])]) + "\n"


def _head(name: str, parser: argparse.ArgumentParser) -> Iterator[str]:
    first, _, rest = (parser.description or "").strip().partition("\n")
    yield f'.TH {name.upper()} 1 "" "wingline {__version__}" wingline'
    yield from _section("NAME", f"{name} - {first.rstrip('.')}")
    yield from _section("SYNOPSIS", f"{name} COMMAND [OPTION]...")
    if rest.strip():
        yield from _section("DESCRIPTION", rest.strip())
    yield ".SH OPTIONS"
    yield from _options(parser)
    if parser.epilog:
        yield ".SH EXAMPLES"
        yield from _as_it_is(parser.epilog)


def _commands(parser: argparse.ArgumentParser) -> Iterator[str]:
    yield ".SH COMMANDS"
    helps = {
        choice.dest: choice.help or ""
        for action in parser._actions  # noqa: SLF001 - argparse tells it in no other way
        for choice in getattr(action, "_choices_actions", ())
    }
    for name, command in commands_of(parser).items():
        yield f".SS {text(command.prog)}"
        yield text(f"{helps[name][:1].upper()}{helps[name][1:]}.")
        yield from _as_it_is(command.format_usage().removeprefix("usage: ").replace("\n       ", "\n"))
        yield from _options(command)
        if command.epilog:
            yield from _as_it_is(command.epilog)


def _options(parser: argparse.ArgumentParser) -> Iterator[str]:
    formatter = parser._get_formatter()  # noqa: SLF001 - as above
    for action in parser._actions:  # noqa: SLF001 - as above
        if isinstance(action, argparse._SubParsersAction) or action.help == argparse.SUPPRESS:  # noqa: SLF001
            continue
        yield ".TP"
        yield rf"\fB{text(formatter._format_action_invocation(action))}\fR"  # noqa: SLF001 - as above
        yield text(formatter._expand_help(action) if action.help else "")  # noqa: SLF001 - as above


def _section(title: str, words: str) -> Iterator[str]:
    yield f".SH {title}"
    yield text(words)


def _as_it_is(words: str) -> Iterator[str]:
    yield from (".PP", ".nf")
    yield from (text(line) for line in words.rstrip().splitlines())
    yield ".fi"


def text(words: str) -> str:
    """Escape words, so that troff takes no line of them for a request."""
    escaped = words.replace("\\", r"\e").replace("-", r"\-")
    return "\n".join(rf"\&{line}" if line[:1] in {".", "'"} else line for line in escaped.splitlines())

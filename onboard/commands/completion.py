"""`onboard completion`: what a shell completes after `onboard`: commands, options, their choices, and files."""

import argparse
from typing import Final

from onboard.commands import cli

SCRIPT: Final = """\
_onboard() {
  local word=${COMP_WORDS[COMP_CWORD]} words=""
  if [ "$COMP_CWORD" -eq 1 ]; then
    COMPREPLY=($(compgen -W "COMMANDS" -- "$word"))
    return
  fi
  case "${COMP_WORDS[1]} ${COMP_WORDS[COMP_CWORD - 1]}" in
CHOICES
  esac
  if [ -z "$words" ] && [ "${word#-}" != "$word" ]; then
    case "${COMP_WORDS[1]}" in
OPTIONS
    esac
  fi
  if [ -n "$words" ]; then
    COMPREPLY=($(compgen -W "$words" -- "$word"))
  else
    local IFS=$'\\n'
    COMPREPLY=($(compgen -f -- "$word"))
  fi
}
complete -o filenames -F _onboard onboard"""


def main(_: argparse.Namespace) -> int:
    """Print the script for bash, which zsh runs after `autoload bashcompinit && bashcompinit`."""
    print(script(cli.parser()))
    return 0


def script(parser: argparse.ArgumentParser) -> str:
    """The script of a parser with commands."""
    commands = commands_of(parser)
    choices, options = [], []
    for name, command in commands.items():
        flags = command._option_string_actions  # noqa: SLF001 - argparse tells it in no other way
        options.append(f'    {name}) words="{" ".join(sorted(f for f in flags if f.startswith("--")))}" ;;')
        for flag, action in flags.items():
            if action.choices:
                choices.append(f'  "{name} {flag}") words="{" ".join(map(str, action.choices))}" ;;')
    filled = SCRIPT.replace("COMMANDS", " ".join(commands))
    return filled.replace("CHOICES", "\n".join(choices)).replace("OPTIONS", "\n".join(options))


def commands_of(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """The parsers of the commands, by their names."""
    found: dict[str, argparse.ArgumentParser] = {}
    for action in parser._actions:  # noqa: SLF001 - as above
        if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001 - as above
            found |= action.choices
    return found

"""Every key, value and example below `--help` exists, and it is there at once."""

import re
import subprocess
import sys

import pytest

from onboard.commands import cli, examples
from onboard.config import load_config
from tests.support.programs import environment

SETS = sorted(
    {s for text in vars(examples).values() if isinstance(text, str) for s in re.findall(r"--set (\S+)", text)}
)


@pytest.mark.parametrize("setting", SETS)
def test_every_setting_in_the_help_is_accepted(setting: str) -> None:
    load_config(None, (setting,))


COMMANDS = ("init", "check", "run", "demo", "replay", "view", "study", "completion", "schema")


@pytest.mark.parametrize("command", COMMANDS)
def test_help_shows_an_example_that_parses(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        cli.main([command, "--help"])
    assert end.value.code == 0
    text = capsys.readouterr().out
    assert f"usage: onboard {command}" in text
    examples = [line.strip() for line in text.splitlines() if line.strip().startswith("onboard ")]
    assert examples
    for example in examples:
        words = example.split("  ")[0].split(" >")[0].split()[1:]
        cli.parser().parse_args(words)


def test_help_and_version_need_neither_numpy_nor_rerun_nor_zenoh() -> None:
    """What a shell's completion or a look at the help would have to wait for."""
    code = (
        "import sys; from onboard.commands import cli\n"
        f"for arguments in (['--help'], ['--version'], *([c, '--help'] for c in {COMMANDS!r})):\n"
        "    try: cli.main(arguments)\n"
        "    except SystemExit as end: assert end.code == 0\n"
        "heavy = {'numpy', 'scipy', 'rerun', 'zenoh', 'numba', 'pymavlink', 'rich', 'msgspec'}\n"
        "sys.exit(','.join(heavy & set(sys.modules)) or 0)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment(), check=False, timeout=300
    )
    assert done.returncode == 0, done.stderr

"""`onboard completion`: what bash completes by its script."""

import shutil
import subprocess
from pathlib import Path

import pytest

from onboard.commands import cli
from onboard.commands.completion import commands_of, script
from onboard.commands.share import TOGETHER

BASH = shutil.which("bash")
ALL = sorted(commands_of(cli.parser()))


@pytest.fixture
def completed(tmp_path: Path):  # type: ignore[no-untyped-def]
    (tmp_path / "a flight.mcap").touch()
    (tmp_path / "companion.toml").touch()

    def complete(*words: str) -> list[str]:
        quoted = " ".join(f"'{word}'" for word in words)
        code = f"{script(cli.parser())}\nCOMP_WORDS=({quoted}); COMP_CWORD={len(words) - 1}; _onboard\n"
        code += 'printf "%s\\n" "${COMPREPLY[@]}"'
        done = subprocess.run(
            [BASH, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True, timeout=60
        )
        assert done.stderr == ""
        return sorted(done.stdout.split("\n")[:-1])

    return complete


@pytest.mark.skipif(BASH is None, reason="bash is not installed")
def test_commands_options_choices_and_files(completed) -> None:  # type: ignore[no-untyped-def]
    assert completed("onboard", "") == ALL
    assert completed("onboard", "re") == ["recover", "replay", "report"]
    assert completed("onboard", "status", "--v") == ["--vehicle"]
    assert "--follow" in completed("onboard", "init", "--")
    assert completed("onboard", "init", "--example", "") == sorted(TOGETHER)
    assert completed("onboard", "init", "--autopilot", "p") == ["px4"]
    assert completed("onboard", "run", "comp") == ["companion.toml"]
    assert completed("onboard", "replay", "a") == ["a flight.mcap"]


def test_every_option_of_every_command_is_in_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["completion"]) == 0
    text = capsys.readouterr().out
    for name, command in commands_of(cli.parser()).items():
        (line,) = (line for line in text.splitlines() if line.strip().startswith(f"{name}) "))
        assert {*line.split('"')[1].split()} == {f for f in command._option_string_actions if f.startswith("--")}

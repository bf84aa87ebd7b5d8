"""Every key and every value in the examples below `--help` exists."""

import re

import pytest

from onboard.commands import examples
from onboard.config import load_config

SETS = sorted(
    {s for text in vars(examples).values() if isinstance(text, str) for s in re.findall(r"--set (\S+)", text)}
)


@pytest.mark.parametrize("setting", SETS)
def test_every_setting_in_the_help_is_accepted(setting: str) -> None:
    load_config(None, (setting,))


def test_there_are_settings_to_test() -> None:
    assert len(SETS) >= 4

"""The page on security says what the code does: every limit, and who may read a recording."""

import importlib
import stat
from pathlib import Path

import pytest

from onboard.commands import recover
from onboard.sinks import recorder
from onboard.sinks.recorder import Recorder
from tests.support import documents

((WHO, LIMITS),) = [documents.tables(documents.text("security"))]
NUMBERED = [(documents.names(what)[0], int(limit.split()[0])) for what, limit, _ in LIMITS]


@pytest.mark.parametrize(("name", "number"), NUMBERED, ids=[name for name, _ in NUMBERED])
def test_a_limit_is_that_of_the_code(name: str, number: int) -> None:
    module, _, constant = name.rpartition(".")
    assert getattr(importlib.import_module(module), constant) == number


def test_the_page_has_rows() -> None:
    assert len(WHO) >= 8
    assert len(LIMITS) >= 20


def test_a_recording_and_its_folder_are_their_owner_s_alone(tmp_path: Path) -> None:
    one = Recorder(tmp_path / "new" / "flight.mcap")
    one.open()
    one.close()
    assert stat.S_IMODE((tmp_path / "new").stat().st_mode) == 0o700
    path, file = recorder.create(tmp_path / "kept.mcap")
    file.close()
    assert stat.S_IMODE(path.stat().st_mode) == recover.FILE_MODE == 0o600

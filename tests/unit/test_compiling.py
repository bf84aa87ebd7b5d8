"""`onboard compile`: every module with kernels, timed by a clock of ours."""

import itertools
import os
from pathlib import Path

from onboard.cli import main
from onboard.compiling import _stem, compile_all, drop_stale
from onboard.models import relative_motion


def test_every_kernel_is_made_ready_and_told() -> None:
    ticks = itertools.count()
    modules = {module.name: module for module in compile_all(lambda: float(next(ticks)))}
    expected = {
        "onboard.filters._kernels_points",
        "onboard.models.relative_motion",
        "onboard.models.camera_angles",
    }
    assert expected <= set(modules)
    assert all(module.loaded + module.compiled > 0 and module.seconds == 2.0 for module in modules.values())
    assert all(module.folder for module in modules.values())


def test_the_command_says_what_it_did(capsys) -> None:  # type: ignore[no-untyped-def]
    assert main(["compile"]) == 0
    *lines, last = capsys.readouterr().out.splitlines()
    assert any(line.startswith("onboard.filters._kernels_points ") for line in lines)
    assert last.startswith("ready in ")


def test_machine_code_older_than_a_source_is_dropped_and_no_other(tmp_path: Path) -> None:
    for name, age in (("mine.f-1.py311.nbi", 5.0), ("mine.g-9.py311.nbi", 50.0), ("other.f-1.py311.nbi", 5.0)):
        (tmp_path / name).touch()
        os.utime(tmp_path / name, (age, age))
    mine = {"mine.f-1", "mine.g-9"}
    assert not drop_stale(tmp_path, mine, newest=4.0)
    assert len(list(tmp_path.iterdir())) == 3
    assert drop_stale(tmp_path, mine, newest=10.0)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine.g-9.py311.nbi", "other.f-1.py311.nbi"]


def test_the_names_of_machine_code_on_disk_are_known() -> None:
    """As Numba names them; if it changed that, nothing would ever be stale."""
    function = relative_motion._process
    names = {path.name.split(".py3", 1)[0] for path in Path(function.stats.cache_path).glob("*.nbi")}
    assert _stem(function) in names

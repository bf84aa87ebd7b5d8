"""`onboard compile`: every module with kernels, timed by a clock of ours."""

import itertools

from onboard.cli import main
from onboard.compiling import compile_all


def test_every_kernel_is_made_ready_and_told() -> None:
    ticks = itertools.count()
    modules = {module.name: module for module in compile_all(lambda: float(next(ticks)))}
    expected = {"onboard.filters._kernels", "onboard.models.relative_motion", "onboard.models.camera_angles"}
    assert expected <= set(modules)
    assert all(module.loaded + module.compiled > 0 and module.seconds == 1.0 for module in modules.values())
    assert all(module.folder for module in modules.values())


def test_the_command_says_what_it_did(capsys) -> None:  # type: ignore[no-untyped-def]
    assert main(["compile"]) == 0
    *lines, last = capsys.readouterr().out.splitlines()
    assert any(line.startswith("onboard.filters._kernels ") for line in lines)
    assert last.startswith("ready in ")

"""How the tests are run: which files begin first, and what is kept of what they compute."""

import shutil
from pathlib import Path

from tests.support import kept, order
from tests.support.programs import ROOT


def test_the_files_that_begin_first_are_there() -> None:
    assert [file for file in order.LONGEST if not (ROOT / file).exists()] == []
    assert order.place(order.LONGEST[1]) == 1
    assert order.place("tests/any_other.py") == len(order.LONGEST)


def test_views_commands_and_links_are_not_of_what_flies() -> None:
    names = {path.relative_to(ROOT).as_posix() for path in kept.what_flies()}
    estimators = {path.relative_to(ROOT).as_posix() for path in (ROOT / "onboard/estimators").rglob("*.py")}
    assert {name for name in estimators if not name.endswith("__init__.py")} <= names
    assert {
        *("onboard/pipeline/pipeline.py", "onboard/wire/mavlink/decode.py", "onboard/clocks/clocks.py"),
        *("onboard/filters/kernels/cholesky.py", "onboard/models/camera_angles.py", "onboard/config/reading.py"),
    } <= names
    others = (
        "onboard/view/",
        "onboard/analysis/",
        "onboard/commands/",
        "onboard/links/",
        "onboard/daemon",
        "onboard/client",
    )
    assert not [name for name in names if name.startswith(others)]


def test_the_digest_of_flights_changes_with_a_source_and_a_scenario(tmp_path: Path) -> None:
    for part in kept.SOURCES:
        copy = shutil.copytree if (ROOT / part).is_dir() else shutil.copy2
        (tmp_path / part).parent.mkdir(exist_ok=True)
        copy(ROOT / part, tmp_path / part)
    found = {kept.digest(), kept.digest(tmp_path)}
    assert len(found) == 1
    for file in ("simlink/world/noise.py", "simlink/scenarios/formation.toml", "onboard/wire/mavlink/encode.py"):
        with (tmp_path / file).open("a", encoding="utf-8") as changed:
            changed.write("# changed")
        found.add(kept.digest(tmp_path))
    assert len(found) == 4

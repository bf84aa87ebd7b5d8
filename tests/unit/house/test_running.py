"""How the tests are run: which files begin first, and that no test runs machine code of another source."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from onboard.pipeline import Pipeline
from simlink.scenarios.scenario import load_scenario
from simlink.simulation import datagrams
from tests.support import kept, kernels, order
from tests.support.programs import ROOT, TIMEOUT_S
from tests.support.streams import Stream, feed, feed_once, make_config

ANGLE = """
import numpy as np
from onboard.models import camera_angles

def test_azimuth():
    state = np.array([[30.0, 30.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0]])
    print("azimuth", camera_angles.measure(state, np.eye(3), np.zeros(3))[0, 0])
"""


def azimuth_by_pytest(copy: Path) -> float:
    """What the tests in a copy of the tree compute, in a process of their own."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("NUMBA", "PYTEST"))}
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-s", "-p", "no:cacheprovider", "tests/test_angle.py"],
        capture_output=True,
        text=True,
        cwd=copy,
        env=environment | {"PYTHONPATH": str(copy)},
        timeout=TIMEOUT_S,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return float(done.stdout.split("azimuth")[1].split()[0])


def test_a_kernel_changed_under_another_file_s_machine_code_is_compiled_anew(tmp_path: Path) -> None:
    for part in ("onboard", "tests/support"):
        shutil.copytree(ROOT / part, tmp_path / part, ignore=shutil.ignore_patterns("*.pyc.*"))
    for file in ("pyproject.toml", "tests/conftest.py"):
        shutil.copy2(ROOT / file, tmp_path / file)
    (tmp_path / "tests/test_angle.py").write_text(ANGLE, encoding="utf-8")
    assert azimuth_by_pytest(tmp_path) == pytest.approx(0.25 * 3.141592653589793)
    inner = tmp_path / "onboard/geometry/arctangent.py"
    text, stat = inner.read_text(encoding="utf-8"), inner.stat()
    assert text.count("return np.copysign(") == 1
    inner.write_text(text.replace("return np.copysign(", "return 7.0 + np.copysign("), encoding="utf-8")
    os.utime(inner, ns=(stat.st_atime_ns, stat.st_mtime_ns))
    assert azimuth_by_pytest(tmp_path) > 7.0


def test_the_files_that_begin_first_are_there() -> None:
    assert [file for file in order.LONGEST if not (ROOT / file).exists()] == []
    assert order.place(order.LONGEST[1]) == 1
    assert order.place("tests/any_other.py") == len(order.LONGEST)


NEW = {"a": [Path(__file__)], "b": [Path(__file__)]}  # written after the stamp
OLD: dict[str, list[Path]] = {"a": [], "b": []}


@pytest.fixture
def stamp(tmp_path: Path) -> Path:
    path = tmp_path / "stamp"
    path.write_text(json.dumps({"a": "these", "b": "those"}), encoding="utf-8")
    os.utime(path, (10.0, 10.0))
    return path


def code(stamp: Path, time_s: float) -> dict[str, list[Path]]:
    path = stamp.with_name("a.nbc")
    path.touch()
    os.utime(path, (time_s, time_s))
    return {"a": [path], "b": []}


def test_machine_code_of_these_sources_made_by_tests_is_known(stamp: Path) -> None:
    assert kernels.unknown(stamp, {"a": "these", "b": "those"}, code(stamp, 9.0), NEW) == []


def test_machine_code_of_other_sources_is_unknown_and_that_of_other_modules_is_kept(stamp: Path) -> None:
    assert kernels.unknown(stamp, {"a": "these", "b": "changed"}, code(stamp, 9.0), OLD) == ["b"]


def test_machine_code_of_another_program_of_a_new_module_or_without_a_stamp_is_unknown(stamp: Path) -> None:
    assert kernels.unknown(stamp, {"a": "these", "b": "those"}, code(stamp, 11.0), NEW) == ["a"]
    assert kernels.unknown(stamp, {"c": "new"}, {"c": []}, {"c": []}) == ["c"]
    assert kernels.unknown(stamp.with_name("none"), {"a": "these"}, code(stamp, 9.0), OLD) == ["a"]


def test_machine_code_that_another_program_made_of_these_sources_is_known(stamp: Path) -> None:
    """A study compiled single precision; the next run of the tests deleted and compiled all, so on and so on."""
    assert kernels.unknown(stamp, {"a": "these", "b": "those"}, code(stamp, 11.0), OLD) == []


def test_machine_code_older_than_a_source_is_made_before_the_tests(stamp: Path) -> None:
    """Git gives a file that it writes again a new time."""
    (compiled,) = code(stamp, 9.0)["a"]
    assert kernels.older([stamp], [compiled])
    os.utime(stamp, (8.0, 8.0))
    assert not kernels.older([stamp], [compiled])
    assert not kernels.older([stamp], [])


def test_machine_code_that_one_test_alone_did_not_make_stays_unknown(
    stamp: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each of several processes would compile it otherwise: the stamp would say that all of it is there."""
    sources = {"a": "these", "made": "new", "missing": "new"}
    nothing: dict[str, list[Path]] = {name: [] for name in sources}
    monkeypatch.setattr(kernels, "STAMP", stamp)
    monkeypatch.setattr(kernels, "digests", lambda: sources)
    kernels.keep(sources, made={"made", "another.module"})
    assert kernels.unknown(stamp, sources, nothing, nothing) == ["missing"]


def test_a_flight_is_kept_as_it_was_simulated_until_a_source_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario, made = load_scenario("formation"), [*datagrams(load_scenario("formation"), 3, 0.5)]
    monkeypatch.setattr(kept, "FOLDER", tmp_path)
    monkeypatch.setattr(kept, "digest", lambda: "these")
    kept._folder.cache_clear()
    assert kept.flight(scenario, 3, 0.5) == made
    with monkeypatch.context() as patch:
        patch.setattr(kept, "datagrams", lambda *_, **_more: pytest.fail("simulated again"))
        assert kept.flight(scenario, 3, 0.5) == made
    assert kept.flight(scenario, 4, 0.5) != made != kept.flight(scenario, 3, 0.5, camera="mavlink")
    assert len([*tmp_path.glob("these/*")]) == 3
    monkeypatch.setattr(kept, "digest", lambda: "those")
    kept._folder.cache_clear()
    assert kept.flight(scenario, 3, 0.5) == made
    assert len([*tmp_path.glob("*/*")]) == 1
    kept._folder.cache_clear()


def test_what_a_pipeline_makes_is_kept_until_what_flies_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent, config = Stream(t1=5.4, sparse=True).datagrams(), make_config()
    monkeypatch.setattr(kept, "OUTPUTS", tmp_path)
    monkeypatch.setattr(kept, "digest_of_what_flies", lambda: "these")
    kept._outputs.cache_clear()
    try:
        plain = feed(sent, config)
        assert feed_once(sent, config).outputs == plain.outputs
        assert [*tmp_path.glob("*/*")] == []  # so short a flight is not worth it
        monkeypatch.setattr(kept, "MIN_COST_TIME_S", 0.0)
        feed_once(sent, config)
        with monkeypatch.context() as patch:
            patch.setattr(Pipeline, "feed", lambda *_: pytest.fail("flown again"))
            again = feed_once([*sent], make_config())
            assert again.outputs == plain.outputs
            assert again.rejected == plain.rejected
        assert again.pipeline.clocks.source == plain.pipeline.clocks.source  # flown again where it is asked for
        feed_once(sent[:-1], config)
        feed_once(sent, make_config("estimator.leader.size_prior_m=2.5"))
        assert len([*tmp_path.glob("these/*")]) == 3
        monkeypatch.setattr(kept, "digest_of_what_flies", lambda: "those")
        kept._outputs.cache_clear()
        feed_once(sent, config)
        assert len([*tmp_path.glob("*/*")]) == 1
    finally:
        kept._outputs.cache_clear()


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


def test_the_digest_is_of_every_source_that_machine_code_may_hold() -> None:
    """A constant's module too, which has no kernels of its own."""
    sources = {path.relative_to(ROOT).as_posix() for path in kernels.sources("onboard.models.camera_angles")}
    assert {"onboard/geometry/arctangent.py", "onboard/filters/compiled.py"} <= sources
    assert "onboard/models/radar.py" not in sources
    every = {path for name in kernels.digests() for path in kernels.sources(name)}
    named = {path.relative_to(ROOT).as_posix() for path in every}
    assert "onboard/models/radar.py" in named
    assert not any(name.startswith(("onboard/wire", "onboard/commands")) for name in named)

"""How the tests are run: which files begin first, and what is kept of what they compute."""

import shutil
from pathlib import Path

import pytest

from onboard.pipeline import Pipeline
from simlink.scenarios.scenario import load_scenario
from simlink.simulation import datagrams
from tests.support import kept, order
from tests.support.programs import ROOT
from tests.support.streams import Stream, feed, feed_once, make_config


def test_the_files_that_begin_first_are_there() -> None:
    assert [file for file in order.LONGEST if not (ROOT / file).exists()] == []
    assert order.place(order.LONGEST[1]) == 1
    assert order.place("tests/any_other.py") == len(order.LONGEST)


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

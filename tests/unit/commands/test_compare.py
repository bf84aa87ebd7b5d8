"""`onboard replay --compare`: other filters and settings on the same bytes, and what was flown."""

import csv
import json
from pathlib import Path

import pytest

from onboard import UserError
from onboard.analysis.flights.compare import filters, variants
from onboard.analysis.flights.replay import FLOWN, replay
from onboard.commands.cli import main
from onboard.estimators import config_type
from onboard.messages import Estimate, Output
from onboard.pipeline import Pipeline
from onboard.sinks.recorder import Recorder
from tests.support.streams import Stream, make_config

SIZE = ("--set", "estimator.leader.size_prior_m=2.0")


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording with the estimates that were made in flight: of a wing of 2.5 m, which was wrong."""
    path = tmp_path_factory.mktemp("flown") / "flight.mcap"
    pipeline, recorder = Pipeline(make_config("estimator.leader.size_prior_m=2.5")), Recorder(path)
    recorder.open()
    for datagram in Stream(t1=13.0, sparse=True).datagrams():
        recorder.write([datagram, *pipeline.feed(datagram)])
    recorder.close()
    return path


def test_each_is_as_it_is_alone(recording: Path) -> None:
    wide = make_config("estimator.leader.size_prior_sigma_m=0.5")
    made: list[Output] = []
    together = replay(recording, make_config(), others={"wide": wide, FLOWN: make_config()}, take=made.append)
    alone, beside = replay(recording, make_config()), replay(recording, wide)
    assert together.estimates == alone.estimates
    assert [e.mean for e in together.beside["wide"]] == [e.mean for e in beside.estimates]
    flown = replay(recording, make_config("estimator.leader.size_prior_m=2.5"))
    assert [e.mean for e in together.beside[FLOWN]] == [e.mean for e in flown.estimates]
    order = [output.name for output in made if isinstance(output, Estimate)]
    assert order[:10].count(FLOWN) in (3, 4)  # among the others, not after them: the view goes by time


def test_the_table_has_a_column_for_each(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    rows, numbers = tmp_path / "rows.csv", tmp_path / "score.json"
    words = ["flown", "paper", "few:estimator.leader.particles=300", "large:estimator.leader.size_prior_m=3"]
    call = ["replay", str(recording), *SIZE, "--out", str(rows), "--json", str(numbers), "--compare", *words]
    assert main(call) == 0
    printed = capsys.readouterr().out
    (head,) = [line for line in printed.splitlines() if "large" in line and "flown" in line]
    columns = set(head.replace("┃", " ").split())
    assert columns == {"leader", "flown", "large", "paper", "few"}
    (estimates,) = [line for line in printed.splitlines() if line.startswith("estimates")]
    assert estimates.count("valid") == 5
    assert set(json.loads(numbers.read_text("utf-8"))["beside"]) == {"flown", "paper", "few", "large"}
    with rows.open(encoding="utf-8") as file:
        assert {row["estimator"] for row in csv.DictReader(file)} == columns


def test_a_filter_is_of_the_estimator_that_has_it() -> None:
    sets = ("estimator.leader={}", "estimator.own_state={}")
    found = variants(["belief", "cubature", "paper"], None, sets)
    assert found["belief"].estimator["leader"].filter == "belief"
    assert found["cubature"].estimator["own_state"].filter == "cubature"
    assert set(found["paper"].estimator) == {"oh_johnson", "own_state"}
    assert "srukf" in filters(config_type("traffic")())


def test_keys_are_named_or_name_themselves() -> None:
    found = variants(["near:camera.f_px=500;camera.cx_px=300", "camera.f_px=600"], None, ())
    assert (found["near"].camera.f_px, found["near"].camera.cx_px) == (500.0, 300.0)
    assert found["camera.f_px-600"].camera.f_px == 600.0


@pytest.mark.parametrize(
    ("word", "reason"),
    [("nonsense", "there are: flown .*belief of leader"), ("leader:camera.f_px=1", "the name leader is taken")],
)
def test_a_word_that_is_none_is_explained(word: str, reason: str) -> None:
    with pytest.raises(UserError, match=reason):
        variants([word], None, ())

"""`onboard replay --compare`: other filters and settings on the same bytes, and what was flown."""

import csv
import json
from pathlib import Path

import pytest

from onboard.analysis.flights.replay import FLOWN, replay
from onboard.commands.cli import main
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

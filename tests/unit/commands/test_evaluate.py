"""`onboard evaluate`: a folder of flights with truth, filters on each, scores by family; and many logs at once."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from onboard import UserError
from onboard.commands.cli import main
from onboard.commands.evaluate import find_flights, read_rows
from tests.support.records import record
from tests.support.streams import Flight, Stream, write_truth

FAMILIES = {"straight": Flight(radius=None), "turning": Flight()}
END = 14.0
TRUE_FROM = -6.0  # the first 15 s of the truth are not scored


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two families: one of two flights, one of one."""
    root = tmp_path_factory.mktemp("dataset")
    (root / "config.toml").write_text("[estimator.leader]\nsize_prior_m = 2.0\n", encoding="utf-8")
    for family, seeds in (("straight", (1, 2)), ("turning", (3,))):
        for seed in seeds:
            write_flight(root / family / f"seed-{seed}", FAMILIES[family], seed)
    return root


def write_flight(folder: Path, flight: Flight, seed: int) -> None:
    folder.mkdir(parents=True)
    record(folder / "log.mcap", Stream(flight=flight, t1=END, seed=seed, sparse=True).datagrams())
    write_truth(folder / "truth.csv", flight, np.arange(TRUE_FROM, END, 0.1).tolist())


def test_flights_are_found_with_their_family_and_the_nearest_configuration(dataset: Path) -> None:
    flights = find_flights(dataset, (), ())
    assert [(f.name, f.family) for f in flights] == [
        ("straight/seed-1", "straight"),
        ("straight/seed-2", "straight"),
        ("turning/seed-3", "turning"),
    ]
    assert {f.config for f in flights} == {dataset / "config.toml"}


def test_scores_are_by_family_and_others_can_add_to_them(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("filterpy", reason="needs filterpy: the baseline")
    monkeypatch.setenv("COLUMNS", "200")
    ours, theirs = tmp_path / "ours.json", tmp_path / "theirs.json"
    monkeypatch.setattr(os, "cpu_count", lambda: 1)  # in this process: new ones take longer than the flights
    assert main(["evaluate", str(dataset), "--json", str(ours)]) == 0
    rows = read_rows(ours)
    assert {name: set(filters) for name, filters in rows.items()} == {
        "straight": {"leader", "paper", "filterpy"},
        "turning": {"leader", "paper", "filterpy"},
    }
    leader = rows["straight"]["leader"]
    assert leader.flights == 2
    assert leader.valid_percent is not None
    assert leader.valid_percent > 95
    for name in ("leader", "paper", "filterpy"):
        error = rows["straight"][name].range_error_rms_percent
        assert error is not None
        assert error < 12, name
    tree = json.loads(ours.read_text("utf-8"))
    assert [flight["name"] for flight in tree["flights"]][-1] == "turning/seed-3"
    tree["families"] = {
        "straight": {"somebody": tree["families"]["straight"]["leader"] | {"valid_percent": 12.25}}
    }
    theirs.write_text(json.dumps(tree), encoding="utf-8")
    capsys.readouterr()
    assert main(["evaluate", str(dataset / "straight"), "--compare", "--with", str(theirs)]) == 0
    (line,) = [line for line in capsys.readouterr().out.splitlines() if "somebody" in line]
    assert "12.25" in line


def test_several_logs_give_a_row_each_and_rows_of_parquet(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="needs pyarrow: the extra `parquet`")
    monkeypatch.setenv("COLUMNS", "250")
    monkeypatch.setattr(os, "cpu_count", lambda: 1)
    logs = [str(dataset / "straight" / f"seed-{seed}") for seed in (1, 2)]
    config = str(dataset / "config.toml")
    assert main(["replay", *logs, "--config", config, "--rows", str(tmp_path / "rows.parquet")]) == 0
    printed = capsys.readouterr().out
    assert [line.split()[0] for line in printed.splitlines() if "seed-" in line] == logs
    table = parquet.read_table(tmp_path / "rows.parquet").to_pylist()
    assert [row["part"] for row in table] == [0, 1]
    assert json.loads(table[1]["result"])["scores"]["leader"]["scored"] > 50


def test_a_flight_without_truth_is_named(dataset: Path, tmp_path: Path) -> None:
    folder = tmp_path / "family" / "flight"
    folder.mkdir(parents=True)
    (folder / "log.mcap").write_bytes((dataset / "turning" / "seed-3" / "log.mcap").read_bytes())
    with pytest.raises(UserError, match=r"family/flight: it has no truth"):
        find_flights(tmp_path, (), ())
    with pytest.raises(UserError, match="there is no flight in it"):
        find_flights(_empty(tmp_path), (), ())


def _empty(tmp_path: Path) -> Path:
    (tmp_path / "empty").mkdir()
    return tmp_path / "empty"

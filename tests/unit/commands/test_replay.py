"""A replay's own parts: whose estimates are scored as the leader's, and what flies beside."""

import csv
import json
import struct
from pathlib import Path
from typing import Any

import pytest

from onboard import UserError
from onboard.analysis.flights.replay import replay
from onboard.commands.replay import replay_log
from onboard.config import Config, load_config
from onboard.messages import Advice, Health, LocalPosition, TargetPoints
from onboard.sinks.recorder import Recorder, Rotation
from onboard.wire.logs.recording import parts_of
from tests.support.records import record
from tests.support.streams import Stream, encode, make_config


def replayed_numbers(log: Path, config: Config) -> tuple[dict[str, Any], list[dict[str, str]]]:
    """The JSON of a replay, and the rows of its `--out`."""
    rows, numbers = log.with_suffix(".csv"), log.with_suffix(".json")
    replay_log(log, config, out=[rows], truth=None, json_file=numbers, rrd=None)
    with rows.open(encoding="utf-8") as file:
        return json.loads(numbers.read_text("utf-8")), list(csv.DictReader(file))


SCORED = ("estimates", "valid", "nis_mean", "images_scored", "verdicts")


def test_two_estimators_of_the_leader_are_scored_each_by_itself(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, paper = tmp_path / "flight.mcap", "estimator.oh_johnson={}"
    record(log, Stream(t1=21.0, sparse=True).datagrams())
    both, rows = replayed_numbers(log, make_config(paper))
    assert "beside it: oh_johnson" in capsys.readouterr().out
    alone, of_leader = replayed_numbers(log, make_config())
    assert alone["beside"] == {}
    assert [both[key] for key in SCORED] == [alone[key] for key in SCORED]
    assert list(both["beside"]) == ["oh_johnson"]
    assert [row for row in rows if row["estimator"] == "leader"] == of_leader
    of_paper = [row for row in rows if row["estimator"] == "oh_johnson"]
    assert len(of_paper) == both["beside"]["oh_johnson"]["estimates"]
    only = load_config(None, (paper,))
    assert "leader" not in only.estimator
    by_itself, _ = replayed_numbers(log, only)  # with no other, it is the one that is judged
    assert [by_itself[key] for key in SCORED] == [both["beside"]["oh_johnson"][key] for key in SCORED]
    assert by_itself["beside"] == {}
    kept = replay(log, make_config(paper))
    assert {e.name for e in kept.estimates} == {"leader"}
    assert len(kept.beside["oh_johnson"]) == len(of_paper)


def test_a_log_without_images_shows_what_there_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "flight.mcap"
    record(log, encode(i for i in Stream(t1=12.0, sparse=True).items() if not isinstance(i.message, TargetPoints)))
    numbers, _ = replayed_numbers(log, make_config())
    shown = capsys.readouterr().out
    assert numbers["valid"] == 0
    assert "nothing to estimate the leader from" in shown
    assert "to estimate our own state: --set estimator.own_state={}" in shown
    assert "valid" not in shown.replace("invalid", "")
    assert "leader at the end: searching, no image yet" in shown
    record(log, encode(i for i in Stream(t1=7.0).items() if not isinstance(i.message, LocalPosition)))
    replayed_numbers(log, make_config("estimator.own_state={}"))
    shown = capsys.readouterr().out
    assert "to estimate our own state" not in shown
    assert "own_state at the end: searching, no GPS fix yet" in shown


def test_the_health_of_a_stranger_s_log_has_no_remedies_since_they_name_our_configuration(tmp_path: Path) -> None:
    datagrams = encode(i for i in Stream(t1=7.0, sparse=True).items() if not isinstance(i.message, LocalPosition))
    record(tmp_path / "ours.mcap", datagrams)
    rows = (struct.pack(">Q", d.t_recv_ns // 1000) + d.data for d in datagrams)
    (tmp_path / "theirs.tlog").write_bytes(b"".join(rows))
    given: dict[str, list[Advice]] = {}
    for name in ("ours.mcap", "theirs.tlog"):
        healths: list[Health] = []
        healths.append(replay(tmp_path / name, make_config(), take_health=healths.append).health)
        given[name] = [advice for health in healths for advice in health.advice]
    assert any(advice.remedy for advice in given["ours.mcap"])
    assert given["theirs.tlog"]
    assert not any(advice.remedy for advice in given["theirs.tlog"])


def test_the_parts_of_a_recording_are_replayed_as_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A recorder that begins a new file by size left flights of which only the first part was replayed."""
    config = make_config()
    datagrams = encode(Stream(t1=6.0, sparse=True).items())
    record(tmp_path / "whole.mcap", datagrams)
    folder = tmp_path / "parts"
    recorder = Recorder(
        folder / "flight.mcap", rotation=Rotation(file_bytes=1.0), monotonic=iter(range(10**6)).__next__
    )
    folder.mkdir()
    recorder.open()
    for i in range(0, len(datagrams), 200):
        recorder.write(datagrams[i : i + 200])
    recorder.close()
    record(tmp_path / "other.mcap", datagrams[:200])
    parts = parts_of(folder / "flight.mcap")
    assert [part.name for part in parts[:2]] == ["flight.mcap", "flight-2.mcap"]
    assert len(parts) == len(list(folder.iterdir()))
    whole = replay(tmp_path / "whole.mcap", config)
    for log in (folder / "flight.mcap", folder):
        joined = replay(log, config)
        assert joined.records == whole.records
        assert joined.estimates == whole.estimates
    assert parts_of(parts[1]) == parts[1:]
    assert replay_log(folder, config, truth=None, json_file=None, rrd=None) == 0
    assert "joined: flight.mcap, flight-2.mcap" in capsys.readouterr().out
    record(folder / "flight.mcap", datagrams[:200])  # of another run: a second flight in this folder
    with pytest.raises(UserError, match="expected one log"):
        replay(folder, config)

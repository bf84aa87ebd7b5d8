"""`onboard replay` of a flight made by hand: its tables, its numbers, and every format of export."""

import csv
import io
import json
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from onboard.analysis.exports.csv_rows import TEXT_COLUMNS
from onboard.commands import replay as command
from onboard.commands.cli import main
from tests.support import made_flight
from tests.support.golden import assert_golden, numbers, rounded
from tests.support.records import record
from tests.support.streams import Stream

BEGIN_NS = 2_000_000_000  # of the messages that are shown


@pytest.fixture(autouse=True)
def in_its_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder with a recording and a truth, in place of whose replay comes the flight made by hand."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "150")
    monkeypatch.setattr(command, "replay", made_flight.replay)
    record(tmp_path / "flight.mcap", Stream(t1=5.1).datagrams())
    (tmp_path / "truth.csv").write_text(made_flight.truth(), encoding="utf-8")


def columns(path: Path) -> Iterator[str]:
    """Each column of a table, as its first value and all numbers."""
    head, *rows = [line.split(",") for line in path.read_text(encoding="utf-8").splitlines()]
    for name, values in zip(head, zip(*rows, strict=True), strict=True):
        known = [value for value in values if value]
        are_words = any(value[:1].isalpha() for value in known)
        figures = Counter(values).most_common() if are_words else numbers([float(v or "nan") for v in values])
        yield f"{name}: {known[-1] if known else None}; {figures}"


def test_tables_numbers_and_text_exports(capsys: pytest.CaptureFixture[str]) -> None:
    outs = ["--out", "leader.csv", "--out", "leader.tum", "--own", "own.csv", "--own", "own.tum"]
    assert main(["replay", "flight.mcap", "--truth", "truth.csv", *outs, "--json", "score.json"]) == 0
    lines = ["WITH A TRUTH", capsys.readouterr().out]
    score = json.loads(Path("score.json").read_text("utf-8"))
    lines += [rounded(json.dumps({k: v for k, v in score.items() if k != "health"}, indent=1))]
    lines += [f"health has {sorted(score['health'])}"]
    for name in ("leader.csv", "own.csv"):
        lines += [name, *columns(Path(name))]
    for name in ("leader.tum", "leader-truth.tum", "own.tum"):
        text = Path(name).read_text("utf-8")
        lines += [name, text.partition("\n")[0], *(numbers(column) for column in np.loadtxt(io.StringIO(text)).T)]
    assert main(["replay", "flight.mcap", "--set", "estimator.own_state={}", "--compare", "paper"]) == 0
    assert_golden("replay.txt", [*lines, "COMPARED", capsys.readouterr().out])


def test_parquet_is_the_csv_with_all_digits() -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="needs pyarrow: the extra `parquet`")
    assert main(["replay", "flight.mcap", "--out", "a.csv", "--out", "a.parquet", "--out", "rows"]) == 0
    assert Path("rows").read_bytes() == Path("a.csv").read_bytes()  # without a suffix
    table, rows = parquet.read_table("a.parquet"), [*csv.DictReader(Path("a.csv").read_text("utf-8").splitlines())]
    assert table.column_names == list(rows[0])
    for name in table.column_names:
        theirs, ours = table[name].to_pylist(), [row[name] or None for row in rows]
        are_words = name in TEXT_COLUMNS
        assert theirs == (ours if are_words else pytest.approx([v and float(v) for v in ours], abs=1e-6)), name


def test_what_cannot_be_written_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    Path("out.ros2").mkdir()
    assert main(["replay", "flight.mcap", "--out", "out.ros2"]) == 2
    assert "cannot write out.ros2: it exists, and a bag is a folder of its own" in capsys.readouterr().err
    assert main(["replay", "flight.mcap", "--out", "estimates.txt"]) == 2
    assert "one of .csv, .parquet, .tum, .mcap, .ros2" in capsys.readouterr().err


def test_evo_reads_it() -> None:
    evo = shutil.which("evo_ape", path=str(Path(sys.executable).parent)) or shutil.which("evo_ape")
    if evo is None:
        pytest.skip("needs evo (pip install evo), which is large")
    assert main(["replay", "flight.mcap", "--truth", "truth.csv", "--out", "a.tum"]) == 0
    done = subprocess.run(
        [evo, "tum", "a-truth.tum", "a.tum"], capture_output=True, text=True, check=True, timeout=300
    )
    (rmse,) = [float(line.split()[1]) for line in done.stdout.splitlines() if line.split()[:1] == ["rmse"]]
    assert rmse == pytest.approx(0.4, abs=0.1)


def topics(read: list[tuple[str, int, Any]]) -> Iterator[str]:
    """How many messages of each topic, and its first two from BEGIN_NS on."""
    for topic in sorted({topic for topic, *_ in read}):
        of_topic = [(t, message) for other, t, message in read if other == topic]
        later = [(t, message) for t, message in of_topic if t >= BEGIN_NS]
        yield f"{topic}: {len(of_topic)}"
        yield from (f"{t} {rounded(' '.join(str(message).split()))}" for t, message in later[:2])


def test_foxglove_s_own_schemas() -> None:
    pytest.importorskip("mcap_protobuf", reason="needs the extra `foxglove`")
    from mcap_protobuf.decoder import DecoderFactory  # noqa: PLC0415

    assert main(["replay", "flight.mcap", "--out", "out.mcap"]) == 0
    with Path("out.mcap").open("rb") as file:
        messages = [*make_reader(file).iter_messages()]
        factory = DecoderFactory()
        decoders = {
            schema.name: factory.decoder_for(channel.message_encoding, schema) for schema, channel, _ in messages
        }
        read = [
            (channel.topic, message.log_time, decode(message.data) if decode else "JSON")
            for schema, channel, message in messages
            for decode in [decoders[schema.name]]
        ]
    assert_golden("foxglove.txt", topics(read))


def test_a_bag_of_ros() -> None:
    highlevel = pytest.importorskip("rosbags.highlevel", reason="needs the extra `ros2`")
    assert main(["replay", "flight.mcap", "--out", "out.ros2"]) == 0
    with highlevel.AnyReader([Path("out.ros2")]) as bag, np.printoptions(precision=5, suppress=True):
        read = [(c.topic, t, bag.deserialize(data, c.msgtype)) for c, t, data in bag.messages()]
        assert_golden("ros_bag.txt", topics(read))

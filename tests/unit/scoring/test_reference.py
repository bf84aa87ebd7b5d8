"""The truth that estimates are scored against: read from a table, or made of records."""

import csv
import gzip
import io
from pathlib import Path

import pytest

from onboard.models import relative_motion
from onboard.scoring.reference import TRUTH_COLUMNS, TruthError, reference_from_csv, reference_from_records
from tests.support.vehicle_records import truth

S = 1_000_000_000


def table(columns: list[str]) -> str:
    out = io.StringIO()
    writer = csv.writer(out)
    writer.writerow(["time_boot_s", *columns, "leader_q_w"])
    for t in (40.0, 40.04, 40.08):
        writer.writerow([t, *(10.0 * t + i for i in range(len(columns))), 1.0])
    return out.getvalue()


@pytest.mark.parametrize("compressed", [False, True], ids=["csv", "csv.gz"])
@pytest.mark.parametrize("count", [7, 9], ids=["without accelerations", "with accelerations"])
def test_truth_table_is_read(tmp_path: Path, compressed: bool, count: int) -> None:
    columns = list(TRUTH_COLUMNS)[:count]
    path = tmp_path / ("t.csv.gz" if compressed else "t.csv")
    data = table(columns).encode()
    path.write_bytes(gzip.compress(data) if compressed else data)
    read = reference_from_csv(path)
    assert read.components == relative_motion.COMPONENTS[:count]
    assert read.time.tolist() == [40.0, 40.04, 40.08]
    assert read.values[1].tolist() == pytest.approx([400.4 + i for i in range(count)])


def test_columns_may_stand_in_any_order(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text(table(list(TRUTH_COLUMNS)[::-1]))
    read = reference_from_csv(path)
    assert read.components == relative_motion.COMPONENTS
    assert read.values[0].tolist() == pytest.approx([408.0 - i for i in range(9)])


def test_truth_that_stands_still_in_time_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    text = table(list(TRUTH_COLUMNS))
    path.write_text(text + text.splitlines()[-1] + "\n")
    with pytest.raises(TruthError, match="rising"):
        reference_from_csv(path)


def test_records_are_put_in_order_and_duplicates_dropped() -> None:
    accelerations = {"a_lat": 8.0, "a_long": 9.0}
    rows = [
        truth(t * S, r_FL_n=(1.0 * t * S, 2.0, 3.0), v_FL_n=(4.0, 5.0, 6.0), size=7.0, **accelerations)
        for t in (3, 1, 3, 2)
    ]
    read = reference_from_records(rows)
    assert read.time.tolist() == [1.0, 2.0, 3.0]
    assert read.values[0].tolist() == [1.0 * S, 2, 3, 4, 5, 6, 7, 8, 9]
    assert len(reference_from_records([]).time) == 0

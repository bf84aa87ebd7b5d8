"""docs/installed.md: the table has every package that an installation brings, and says which ones fly."""

import re
from pathlib import Path

import pytest
import sizes

from tests.support import documents

TABLE, *_ = documents.tables(documents.text("installed"))
ROWS = [row for row in TABLE if not row[0].startswith("**")]


def test_every_package_that_is_required_has_a_row_with_who_requires_it() -> None:
    shown = {name: by for name, _, _, _, by in ROWS}
    needed = {
        n: ", ".join("us" if one == sizes.PROJECT else one for one in by) for n, by in sizes.closure().items()
    }
    assert shown == needed
    assert "scipy" in needed
    assert not {"numba", "llvmlite"} & {*needed}


def test_the_page_says_what_a_flight_loads() -> None:
    shown = {name for name, _, _, flies, _ in ROWS if flies == "yes"}
    assert shown == sizes.loaded_distributions() & {*sizes.closure()}
    assert {"eclipse-zenoh", "pyserial", "mcap"} <= shown


def test_the_sum_is_that_of_the_rows() -> None:
    (total,) = (row for row in TABLE if row[0].startswith("**"))
    whole, flown = map(int, re.findall(r"\d+", total[2]))
    assert whole == pytest.approx(sum(float(row[2]) for row in ROWS), abs=1.5)
    assert flown == pytest.approx(sum(float(row[2]) for row in ROWS if row[3] == "yes"), abs=1.5)


def test_writing_it_again_changes_the_table_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = tmp_path / "installed.md"
    page.write_text(f"before\n\n{sizes.BEGIN}\nold\n{sizes.END}\n\nafter\n", encoding="utf-8")
    monkeypatch.setattr(sizes, "PAGE", page)
    monkeypatch.setattr(sizes, "sizes", lambda: [sizes.Size("numpy", "2.0", 57_440_000, ("wingline",), True)])
    assert sizes.main() == 0
    text = page.read_text(encoding="utf-8")
    assert "| numpy | 2.0 | 57.4 | yes | us |" in text
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    assert "old" not in text

"""docs/installed.md: the table has every package that an installation brings, and says which ones fly."""

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

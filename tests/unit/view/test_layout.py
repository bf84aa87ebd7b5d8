"""The layout of the window: every page has what it should, in shares that fit its parts."""

from collections.abc import Iterator
from typing import Any

import pytest

from tests.support.view_flight import CAMERA, NEEDS_RERUN

layout = pytest.importorskip("onboard.view.layout", reason=NEEDS_RERUN, exc_type=ImportError)


def parts(part: Any) -> Iterator[Any]:
    """A container or view, and all in it."""
    yield part
    for inner in getattr(part, "contents", ()) if hasattr(part, "row_shares") else ():
        yield from parts(inner)


def named(own_state: bool) -> dict[str, Any]:
    window = layout.blueprint(CAMERA, own_state=own_state).root_container
    return {part.name: part for part in parts(window) if part.name}


@pytest.mark.parametrize("own_state", [False, True])
def test_each_share_is_of_one_part(own_state: bool) -> None:
    window = layout.blueprint(CAMERA, own_state=own_state).root_container
    shared = 0
    for part in parts(window):
        for shares in (getattr(part, "row_shares", None), getattr(part, "column_shares", None)):
            if shares is not None:
                shared += 1
                assert len(shares) == len(part.contents)
                assert min(shares) > 0.1
    assert shared == 5


def test_the_map_of_traffic_has_a_little_more_room_than_its_table() -> None:
    page = named(False)["Traffic"]
    assert [view.origin for view in page.contents] == ["/traffic/map", "/traffic/table"]
    above, below = page.row_shares
    assert 1.2 < above / below < 1.5


def test_our_own_state_comes_first_where_it_is_estimated() -> None:
    assert "Both" not in named(False)
    assert "Both" in named(True)
    assert list(named(True)).index("Both") < list(named(True)).index("Overview")

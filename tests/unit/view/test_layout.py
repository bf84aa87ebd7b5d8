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


SEVERAL = [
    layout.Contents(),
    layout.Contents(own=True),
    layout.Contents(leader=False, own=True),
    layout.Contents(leader=False, traffic=True),
    layout.Contents(own=True, traffic=True, threat=True, fleet=True),
]
NOTHING = layout.Contents(leader=False)


def window(shown: Any) -> Any:
    return layout.blueprint(CAMERA, shown).root_container


def named(shown: Any) -> dict[str, Any]:
    return {part.name: part for part in parts(window(shown)) if part.name}


def open_page(shown: Any) -> str:
    """The name of the page that is open among the plots."""
    (tabs,) = [
        part
        for part in parts(window(shown))
        if getattr(part, "active_tab", None) is not None and len(part.contents) > 5
    ]
    return str(tabs.contents[tabs.active_tab].name)


@pytest.mark.parametrize("shown", SEVERAL, ids=str)
def test_each_share_is_of_one_part(shown: Any) -> None:
    shared = 0
    for part in parts(window(shown)):
        for shares in (getattr(part, "row_shares", None), getattr(part, "column_shares", None)):
            if shares is not None:
                shared += 1
                assert len(shares) == len(part.contents)
                assert min(shares) > 0.1
    assert shared >= 4


@pytest.mark.parametrize(
    ("shown", "page"),
    [*zip(SEVERAL, ["Overview", "Both", "Own", "Traffic", "Traffic"], strict=True)],
    ids=str,
)
def test_the_first_page_is_of_what_flies(shown: Any, page: str) -> None:
    assert open_page(shown) == page


def test_what_does_not_fly_has_no_room() -> None:
    alone = named(layout.Contents(leader=False, own=True))
    assert "Our rotors" in alone
    assert "Now" in alone
    assert not [name for name in alone if name.startswith(("Camera", "Leader, close"))]
    assert "Track, images, own state, faults" in named(layout.Contents(own=True))
    assert "Fleet" in named(layout.Contents(fleet=True))
    assert [name for name in named(NOTHING) if name.startswith("Camera")]  # nothing is known yet


def test_errors_are_shown_where_there_is_a_truth() -> None:
    assert "Leader: error in range [m] ±3σ" in named(layout.Contents(truth=True))
    assert "Leader: error in range [m] ±3σ" not in named(layout.Contents())

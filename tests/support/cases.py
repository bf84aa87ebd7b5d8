"""Tables of cases, most of them slow."""

from collections.abc import Collection, Iterable
from typing import Any

import pytest


def slow_but(quick: Collection[Any], cases: Iterable[Any]) -> list[Any]:
    """Return cases for `parametrize`, with all but the quick ones marked slow.

    Raises ValueError if a quick one is no case.
    """
    every = list(cases)
    if not set(quick) <= set(every):
        raise ValueError(f"no cases: {set(quick) - set(every)}")
    return [
        case
        if case in quick
        else pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.slow)
        for case in every
    ]

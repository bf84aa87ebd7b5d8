"""Tables of cases of which few are quick."""

from collections.abc import Collection, Iterable
from typing import Any

import pytest


def slow_but(quick: Collection[Any], cases: Iterable[Any]) -> list[Any]:
    """Cases for `parametrize`, of which all but the quick ones are marked slow.

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

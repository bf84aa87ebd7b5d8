"""A table whose rows are read by one test, not one item each."""

import functools
import inspect
from collections.abc import Callable, Mapping
from typing import Any

import pytest


def each(name: str, rows: Mapping[str, Any]) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Run the test for every row, its argument `name`; failing rows are named together.

    The first one's traceback follows. Fixtures are made once for all rows.
    """

    def over_rows(test: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(test)
        def over_all(**fixtures: Any) -> None:
            failed: dict[str, BaseException] = {}
            for row, value in rows.items():
                try:
                    test(**fixtures, **{name: value})
                except (Exception, pytest.fail.Exception) as error:
                    failed[row] = error
            if failed:
                raise AssertionError(f"{name} {', '.join(failed)}") from next(iter(failed.values()))

        signature = inspect.signature(test)
        others = [parameter for parameter in signature.parameters.values() if parameter.name != name]
        over_all.__signature__ = signature.replace(parameters=others)  # type: ignore[attr-defined]
        return over_all

    return over_rows

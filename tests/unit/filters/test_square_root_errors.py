"""What the square-root filters refuse, and by which name."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from onboard.filters import square_root
from onboard.filters.belief import FilterError, NotPositiveDefiniteError, Weights
from onboard.filters.cubature import weights as cubature_weights
from onboard.filters.square_root import SquareRoot

# ---------------------------------------------------------------------------------- refusals


def step(update: Callable[..., Any] = square_root.update, **changed: Any) -> None:
    given: dict[str, Any] = {
        "mean": np.ones(2), "P": np.eye(2), "factor": None, "Q": np.eye(2), "y": np.ones(2), "R": np.eye(2)
    } | changed  # fmt: skip
    state = square_root.start(given["mean"], given["P"])
    if given["factor"] is not None:
        state = SquareRoot(given["mean"], given["factor"])
    rule = cubature_weights(2)
    update(
        square_root.predict(state, lambda rows: rows, given["Q"], rule), given["y"], lambda r: r, given["R"], rule
    )


NAN, INDEFINITE = np.array([1.0, np.nan]), np.array([[1.0, 2.0], [2.0, 1.0]])


@pytest.mark.parametrize(
    ("name", "bad"),
    [
        ("P", INDEFINITE),
        ("Q", INDEFINITE),
        ("R", INDEFINITE),
        ("Q", np.diag(NAN)),
        ("R", np.diag([1.0, -1e-6])),
        ("factor", np.diag([1.0, -1.0])),
        ("factor", np.diag(NAN)),
        ("factor", np.array([[1.0, 0.0], [0.0, -1e-9]])),
    ],
)
def test_what_has_no_square_root_is_refused_by_name(name: str, bad: Any) -> None:
    with pytest.raises(NotPositiveDefiniteError, match="covariance" if name == "P" else rf"\b{name}\b"):
        step(**{name: bad})


def test_a_centre_without_weight_need_not_be_finite() -> None:
    def hollow(rows: Any) -> Any:  # not a number at the mean
        return rows + 0 / np.hypot(rows[:, :1], rows[:, 1:])

    rule, state = cubature_weights(2), square_root.start(np.zeros(2), np.eye(2))
    with np.errstate(invalid="ignore"):
        state = square_root.predict(state, hollow, np.eye(2), rule)
        found = square_root.update(state, np.zeros(2), hollow, np.eye(2), rule)
    assert_allclose(square_root.belief(found.belief).covariance, 2 / 3 * np.eye(2), rtol=1e-9, atol=1e-9)


def test_weights_that_do_not_belong_together_are_refused() -> None:
    state = square_root.start(np.ones(2), np.eye(2))
    with pytest.raises(FilterError, match="weights"):
        square_root.predict(state, lambda rows: rows, np.eye(2), Weights(1.0, 0.0, 0.0, 0.25))

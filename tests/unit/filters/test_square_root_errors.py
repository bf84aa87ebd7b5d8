"""What the square-root filters refuse, and by which name."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from onboard.filters import square_root
from onboard.filters.belief import FilterError, Weights
from onboard.filters.cubature import weights as cubature_weights

# ---------------------------------------------------------------------------------- refusals


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

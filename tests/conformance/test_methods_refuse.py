"""Every filter method refuses what it cannot use, and the error names the argument. They are found, not listed.

The figures in comments are what was given before it was refused.
"""

import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from onboard.filters import methods
from onboard.filters.belief import Belief, FilterError, Method, NotPositiveDefiniteError
from tests.conformance.problems import broken
from tests.support.filter_problems import identity
from tests.support.tables import each

NAN, INF = float("nan"), float("inf")
INDEFINITE = np.array([[1.0, 2.0], [2.0, 1.0]])
GIVEN: dict[str, Any] = {
    "mean": np.array([10.0, 5.0]),
    "covariance": np.diag([4.0, 1.0]),
    "Q": 0.1 * np.eye(2),
    "y": np.array([10.5, 5.5]),
    "R": np.eye(2),
    "process": identity,
    "measure": identity,
}
VECTORS, MATRICES, MODELS = ("mean", "y"), ("covariance", "Q", "R"), ("process", "measure")
ARRAYS = (*VECTORS, *MATRICES)
every = each("method", methods())


def step(method: Method, **changed: Any) -> Belief:
    """One prediction and one update of two states, both measured, with some arguments replaced."""
    given = GIVEN | changed
    state = method.predict(method.start(given["mean"], given["covariance"]), given["process"], given["Q"])
    return method.belief(method.update(state, given["y"], given["measure"], given["R"], ()).belief)


def refused() -> Iterator[tuple[str, Any, str]]:
    """The argument that is replaced, by what, and a pattern of the message."""
    for name in ARRAYS:
        array = GIVEN[name]
        spoiled = [np.where(array == array.flat[-1], bad, array) for bad in (NAN, INF)]
        types = [array.astype(int), array.astype(np.float32), array.tolist()]
        for wrong in (*spoiled, *types):
            yield name, wrong, rf"\b{name}\b"
        # what is masked was fused: of y = [0.3, --] with 7.0 behind the mask came 6.769
        for kind in (np.ma.masked_array, np.matrix):
            yield name, kind(array), rf"^{name}: must be a NumPy array \(no masked array"
    for name in VECTORS:
        yield name, np.zeros(3), rf"\b{name}\b"
    for name in MATRICES:
        yield name, np.eye(3), rf"\b{name}\b"
        yield name, np.ones(2), rf"\b{name}\b"
    yield "covariance", np.ones((2, 3)), "covariance"
    for wrong in (0.3, None, np.float64(0.3), np.array(0.3), np.array([[10.5], [5.5]])):
        yield "y", wrong, r"^(shapes do not fit: |arrays must agree in axes: )?.*\by\b"
    yield "R", 0.25, r"\bR\b"
    for name in MODELS:
        yield name, broken(identity, NAN), name
        for model in (lambda rows: rows[:, :1], lambda rows: rows[:-1], lambda rows: rows[0]):
            yield name, lambda rows, model=model: model(rows).copy(), name
        yield name, lambda rows: rows.tolist(), rf"\b{name}\b"
        for kind in (np.ma.masked_array, np.matrix):
            yield name, kind, rf"^{name}: must be a NumPy array \(no masked array"


def no_covariances() -> Iterator[tuple[str, Any, str]]:
    """R = -0.25 gave a variance of -0.267."""
    for name in MATRICES:
        for wrong in (-5.0 * np.eye(2), np.diag([1.0, -1e-3]), np.diag([1.0, -1e-9]), INDEFINITE):
            if name == "covariance" or wrong[1, 1] != -1e-9:
                yield name, wrong, rf"^(filter \d of the batch: )?{name}: not positive semi"


@pytest.mark.filterwarnings("ignore:the matrix subclass:PendingDeprecationWarning")
@every
def test_what_cannot_be_used_is_refused_by_name(method: Method) -> None:
    assert np.isfinite(step(method).covariance).all()
    rows = [(*row, FilterError) for row in refused()]
    rows += [(*row, NotPositiveDefiniteError) for row in no_covariances()]
    failed = []
    for name, wrong, pattern, kind in rows:
        try:
            step(method, **{name: wrong})
            failed.append((name, wrong, "accepted"))
        except kind as error:
            if not re.search(pattern, str(error)):
                failed.append((name, wrong, str(error)))
    assert not failed


@every
def test_a_batch_of_another_length_is_refused(method: Method) -> None:
    if "batch" in method.exempt:
        return
    four = {"mean": np.ones((4, 2)), "covariance": np.tile(np.eye(2), (4, 1, 1)), "y": np.ones((4, 2))}
    step(method, **four)
    for name in ("covariance", "Q", "y", "R"):
        three = np.ones((3, 2)) if name == "y" else np.tile(np.eye(2), (3, 1, 1))
        with pytest.raises(FilterError):
            step(method, **(four | {name: three}))


@every
def test_a_noise_of_rank_one_is_one(method: Method) -> None:
    for name in ("Q", "R"):
        assert np.isfinite(step(method, **{name: np.array([[1.0, 2.0], [2.0, 4.0]])}).covariance).all()


@every
def test_a_model_cannot_write_into_the_points(method: Method) -> None:
    """`rows[:, :2] -= sensor`, as bearings-only code often does, moved the mean by `sensor`."""

    def in_place(rows: Any) -> Any:
        rows -= np.array([3.0, -2.0])
        return rows

    for name in MODELS:
        with pytest.raises(ValueError, match="read-only") as caught:
            step(method, **{name: in_place})
        assert "must copy them" in caught.value.__notes__[0]

"""Every filter method refuses what it cannot use: a FilterError that names the argument, and nothing changed."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from onboard.filters import methods
from onboard.filters.belief import FilterError, Method, NotPositiveDefiniteError
from tests.conformance.problems import broken
from tests.support.filter_problems import identity
from tests.support.tables import each

NAN, INF = float("nan"), float("inf")
every = each("method", methods())


def step(method: Method, **changed: Any) -> None:
    """One prediction and one update of two states, both measured, with some arguments replaced."""
    given: dict[str, Any] = {
        "mean": np.array([1.0, 2.0]),
        "covariance": np.diag([1.0, 2.0]),
        "Q": 0.1 * np.eye(2),
        "y": np.array([1.5, 2.5]),
        "R": np.eye(2),
        "process": identity,
        "measure": identity,
    } | changed
    state = method.start(given["mean"], given["covariance"])
    state = method.predict(state, given["process"], given["Q"])
    method.update(state, given["y"], given["measure"], given["R"], ())


@every
def test_the_step_itself_is_accepted(method: Method) -> None:
    step(method)


@every
@pytest.mark.parametrize("value", [NAN, INF])
@pytest.mark.parametrize("name", ["mean", "covariance", "Q", "y", "R"])
def test_what_is_not_finite(method: Method, name: str, value: float) -> None:
    array = np.array([1.0, value]) if name in {"mean", "y"} else np.array([[1.0, 0.0], [0.0, value]])
    with pytest.raises(FilterError, match=rf"\b{name}\b"):
        step(method, **{name: array})


@every
@pytest.mark.parametrize("name", ["process", "measure"])
def test_a_model_that_gives_nan(method: Method, name: str) -> None:
    with pytest.raises(FilterError, match=name):
        step(method, **{name: broken(identity, NAN)})


@every
@pytest.mark.parametrize(
    ("name", "array"),
    [
        ("mean", np.zeros(3)),
        ("covariance", np.eye(3)),
        ("covariance", np.ones((2, 3))),
        ("Q", np.eye(3)),
        ("Q", np.ones(2)),
        ("y", np.zeros(3)),
        ("y", np.array(1.0)),
        ("R", np.eye(3)),
        ("R", np.ones(2)),
    ],
    ids=lambda value: str(getattr(value, "shape", value)),
)
def test_a_wrong_shape(method: Method, name: str, array: Any) -> None:
    with pytest.raises(FilterError, match=rf"\b{name}\b"):
        step(method, **{name: array})


@every
@pytest.mark.parametrize("name", ["covariance", "Q", "y", "R"])
def test_a_batch_of_another_length(method: Method, name: str) -> None:
    if "batch" in method.exempt:
        return
    four = {"mean": np.ones((4, 2)), "covariance": np.tile(np.eye(2), (4, 1, 1)), "y": np.ones((4, 2))}
    step(method, **four)
    three = np.ones((3, 2)) if name == "y" else np.tile(np.eye(2), (3, 1, 1))
    with pytest.raises(FilterError):
        step(method, **(four | {name: three}))


@every
@pytest.mark.parametrize("name", ["process", "measure"])
@pytest.mark.parametrize(
    "model",
    [lambda rows: rows[:, :1], lambda rows: rows[:-1], lambda rows: rows[0]],
    ids=["columns", "rows", "row"],
)
def test_a_model_that_gives_a_wrong_shape(method: Method, name: str, model: Callable[[Any], Any]) -> None:
    with pytest.raises(FilterError, match=name):
        step(method, **{name: lambda rows: model(rows).copy()})


@every
@pytest.mark.parametrize(
    "covariance", [np.diag([1.0, -1e-9]), np.array([[1.0, 2.0], [2.0, 1.0]])], ids=["negative", "indefinite"]
)
def test_a_covariance_without_a_factor(method: Method, covariance: Any) -> None:
    with pytest.raises(NotPositiveDefiniteError, match="covariance"):
        step(method, covariance=covariance)


@every
def test_an_innovation_covariance_without_a_factor(method: Method) -> None:
    with pytest.raises(NotPositiveDefiniteError, match=r"\bR\b"):
        step(method, R=-5.0 * np.eye(2))


@every
@pytest.mark.parametrize("name", ["mean", "covariance", "Q", "y", "R"])
@pytest.mark.parametrize(
    "as_type", [lambda a: a.astype(int), lambda a: a.astype(np.float32), lambda a: a.tolist()],
    ids=["integers", "float32 among float64", "a list"],
)  # fmt: skip
def test_a_wrong_type(method: Method, name: str, as_type: Callable[[Any], Any]) -> None:
    array = np.array([1.0, 2.0]) if name in {"mean", "y"} else np.eye(2)
    with pytest.raises(FilterError, match=rf"\b{name}\b"):
        step(method, **{name: as_type(array)})

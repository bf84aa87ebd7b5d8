"""How the filters call their compiled kernels: one filter is a batch of one, and errors become exceptions."""

from typing import Any, Final

import numpy as np

from onboard.arrays import Array
from onboard.filters.belief import SHAPE, FilterError, Rows, flags, refuse, wrong_arrays
from onboard.filters.unscented_transform import over_rows

# The axes an argument has for one filter; whatever stands before them is a batch.
AXES: Final = {"mean": 1, "y": 1, "predicted": 1} | dict.fromkeys(
    ("covariance", "factor", "F", "H", "Q", "R", "K", "U", "points", "process", "measure", "model"), 2
)


def call(kernel: Any, *options: Any, **arrays: Array) -> list[Any]:
    """The outputs of a kernel without its status, with the arrays' leading axes broadcast together.

    Raises FilterError, NotPositiveDefiniteError: what the status means, or arrays that no kernel takes.
    """
    try:
        depths = [array.ndim - AXES[name] for name, array in arrays.items()]
    except AttributeError as error:
        raise wrong_arrays(**arrays) from error
    if not any(depths):  # one filter: the usual case, and the one where microseconds count
        return [output[0] for output in _run(kernel, options, arrays, lift=True)]
    if min(depths) < 0:
        raise _misfit(arrays)
    if max(depths) > 1:
        lead = _lead(arrays)
        flat = {name: _flat(array, AXES[name], lead) for name, array in arrays.items()}
        return [output.reshape(*lead, *output.shape[1:]) for output in _run(kernel, options, flat)]
    batch = {n: a if d else a[None] for (n, a), d in zip(arrays.items(), depths, strict=True)}
    return _run(kernel, options, batch)


def marks(y: Array, angular: tuple[int, ...], mean: Array, considered: tuple[int, ...]) -> tuple[Any, Any]:
    """The masks of angular components of y and of considered states.

    Raises FilterError.
    """
    try:
        return flags(angular, y.shape[-1]), flags(considered, mean.shape[-1])
    except (AttributeError, IndexError) as error:
        raise wrong_arrays(y=y, mean=mean) from error


def alike(reference: Array, **arrays: Array) -> None:
    """Raises FilterError unless these are arrays of the reference's precision and of its last two axes, and of as
    long a batch if of any."""
    for name, array in arrays.items():
        if not isinstance(array, np.ndarray) or array.dtype != reference.dtype:
            raise wrong_arrays(mean=reference, **{name: array})
        if array.shape[-2:] != reference.shape[-2:]:
            raise FilterError(f"shapes do not fit: {name} {array.shape}, must be {reference.shape[-2:]}")
        if array.ndim > 2 and array.shape != reference.shape:
            raise FilterError(f"shapes do not fit: {name} {array.shape}, must be {reference.shape}")


def images_of(model: Rows, points: Array, y: Array | None) -> Array:
    """A model over points (..., k, n): a measurement's images (..., k, m) like y (..., m), or without one a
    process's.

    Raises FilterError.
    """
    images = over_rows(model, points)
    columns = np.shape(points if y is None else y)[-1:]
    if np.shape(images) != points.shape[:-1] + columns:
        name, given = ("process", "") if y is None else ("measure", f" and y {np.shape(y)}")
        raise FilterError(f"{name}: gave {np.shape(images)} for points {points.shape}{given}")
    return images


def straight(kernel: Any, *options: Any, **arrays: Array) -> list[Any]:
    """The outputs of a kernel without its status, with the arrays as they are.

    Raises FilterError, NotPositiveDefiniteError: what the status means, or arrays that no kernel takes.
    """
    return _run(kernel, options, arrays)


def _run(kernel: Any, options: tuple[Any, ...], arrays: dict[str, Array], lift: bool = False) -> list[Any]:
    try:
        outputs: list[Any]
        given = [array[None] for array in arrays.values()] if lift else arrays.values()
        *outputs, status = kernel(*given, *options)
    except TypeError as error:
        raise wrong_arrays(**arrays) from error
    if status == SHAPE:
        raise _misfit(arrays)
    if status:
        refuse(status)
    return outputs


def _lead(arrays: dict[str, Array]) -> tuple[int, ...]:
    try:
        return np.broadcast_shapes(*[array.shape[: array.ndim - AXES[name]] for name, array in arrays.items()])
    except ValueError as error:
        raise _misfit(arrays) from error


def _flat(array: Array, axes: int, lead: tuple[int, ...]) -> Array:
    if array.ndim == axes:
        return array[None]
    core = array.shape[array.ndim - axes :]
    return np.broadcast_to(array, lead + core).reshape(-1, *core)


def _misfit(arrays: dict[str, Array]) -> FilterError:
    described = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
    return FilterError(f"shapes do not fit: {described}")

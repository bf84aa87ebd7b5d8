"""Calls of compiled kernels: one filter is a batch of one, and a status becomes an exception."""

from typing import Any

import numpy as np

from onboard.arrays import Array
from onboard.filters.belief import mask
from onboard.filters.errors import (
    AXES,
    FilterError,
    array_error,
    is_plain,
    raise_status,
    shape_error,
)


def call(kernel: Any, *options: Any, **arrays: Array) -> list[Any]:
    """Return the outputs of a kernel without its status.

    Leading axes of the arrays are broadcast together. Raises FilterError, NotPositiveDefiniteError by the status,
    or for arrays that no kernel accepts.
    """
    depths = [
        array.ndim - AXES[name] if array.__class__ is np.ndarray or is_plain(array) else -1
        for name, array in arrays.items()
    ]
    if not any(depths):  # one filter: the usual case, and the one where microseconds count
        return [output[0] for output in _run(kernel, options, arrays, lift=True)]
    if min(depths) < 0:
        raise array_error(**arrays)
    lead = _batch_shape(arrays)
    if max(depths) > 1:
        flat = {name: _flattened(array, AXES[name], lead) for name, array in arrays.items()}
        return [output.reshape(*lead, *output.shape[1:]) for output in _run(kernel, options, flat, lead)]
    batch = {n: a if d else a[None] for (n, a), d in zip(arrays.items(), depths, strict=True)}
    return _run(kernel, options, batch, lead)


def masks(y: Array, angular: tuple[int, ...], mean: Array, considered: tuple[int, ...]) -> tuple[Any, Any]:
    """Return the masks of angular components of y (..., m) and of considered states of mean (..., n).

    Raises FilterError.
    """
    try:
        return mask(angular, y.shape[-1]), mask(considered, mean.shape[-1])
    except (AttributeError, IndexError, TypeError) as error:
        raise array_error(y=y, mean=mean, angular=angular, considered=considered) from error


def check_like(reference: Array, **arrays: Array) -> None:
    """Check that arrays are of float64 and have the reference's axes, at least the last two.

    Raises FilterError.
    """
    for name, array in arrays.items():
        if not is_plain(array) or array.dtype != np.float64:
            raise array_error(mean=reference, **{name: array})
        if array.shape[-2:] != reference.shape[-2:]:
            raise FilterError(f"shapes do not fit: {name} {array.shape}, must be {reference.shape[-2:]}")
        if array.ndim > 2 and array.shape != reference.shape:
            raise FilterError(f"shapes do not fit: {name} {array.shape}, must be {reference.shape}")


def call_as_is(kernel: Any, lead: tuple[int, ...], *options: Any, **arrays: Array) -> list[Any]:
    """Return the outputs of a kernel without its status, for arrays of a batch of shape `lead`.

    The arrays are passed unchanged. Raises FilterError, NotPositiveDefiniteError by the status, or for arrays that
    no kernel accepts.
    """
    if not all(array.__class__ is np.ndarray or is_plain(array) for array in arrays.values()):
        raise array_error(**arrays)
    return _run(kernel, options, arrays, lead)


def _run(
    kernel: Any, options: tuple[Any, ...], arrays: dict[str, Array], lead: tuple[int, ...] = (), lift: bool = False
) -> list[Any]:
    try:
        outputs: list[Any]
        passed = [array[None] for array in arrays.values()] if lift else arrays.values()
        *outputs, status = kernel(*passed, *options)
    except TypeError as error:
        raise array_error(**arrays) from error
    if status:
        raise_status(status, lead, **arrays)
    return outputs


def _batch_shape(arrays: dict[str, Array]) -> tuple[int, ...]:
    try:
        return np.broadcast_shapes(*[array.shape[: array.ndim - AXES[name]] for name, array in arrays.items()])
    except ValueError as error:
        raise shape_error(**arrays) from error


def _flattened(array: Array, axes: int, lead: tuple[int, ...]) -> Array:
    if array.ndim == axes:
        return array[None]
    core = array.shape[array.ndim - axes :]
    return np.broadcast_to(array, lead + core).reshape(-1, *core)

"""Angles among the states: a heading of 3.1 rad and one of -3.1 rad are 0.08 rad apart.

Every prediction takes `angular_states`, the indices of states that are angles; so do updates by sigma points, the
smoothers, and `multiple_model.start`. Their differences then wrap. A mean is near the model's own value and is not
moved into [-pi, pi]: a model that wraps its angles keeps them there, within their uncertainty.
"""

import numpy as np

from onboard.arrays import Array
from onboard.filters.belief import mask
from onboard.filters.errors import ANGLE_ERROR, MAX_ANGLE_SPREAD, check_members
from onboard.filters.kernels import images as kernels
from onboard.filters.kernels.calls import call

TWO_PI = 2.0 * np.pi


def beside_first(images: Array, angular_states: tuple[int, ...]) -> Array:
    """Move angles of images by whole turns to within pi of the first image.

    Parameters
    ----------
    images : (..., k, n)
        Images of points.
    angular_states
        Indices of the angles.

    Returns
    -------
    Array
        The moved images (..., k, n).

    Raises
    ------
    FilterError
        If an angle is more than 2 rad from the first image's.
    """
    if not angular_states:
        return images
    (moved,) = call(kernels.beside_first, mask(angular_states, images.shape[-1]), model=images)
    return np.asarray(moved)


def beside(angles: Array, reference: Array, angular_states: tuple[int, ...]) -> Array:
    """Move angles of states (..., n) by whole turns to within pi of those of the reference."""
    if not angular_states:
        return angles
    turns = np.rint((angles - reference) / TWO_PI)
    return np.asarray(angles - TWO_PI * turns * mask(angular_states, angles.shape[-1]))


def check_spread(points: Array, angular_states: tuple[int, ...]) -> None:
    """Check that sigma points (..., k, n), the mean first, are near the mean in all angles.

    Raises
    ------
    FilterError
        If an angle is more than 2 rad from the mean's.
    """
    if angular_states:
        far = np.abs(points - points[..., :1, :]) > MAX_ANGLE_SPREAD
        check_members(far[..., mask(angular_states, points.shape[-1])].any(axis=(-2, -1)), ANGLE_ERROR)

"""Compiled arithmetic of the images of sigma points: their mean, deviations from it, and angles among them.

Batches as in `linear`.
"""

import numpy as np

from onboard.compiled import FILLING, FLAGS, MAKING, kernel, signature
from onboard.filters.errors import ANGLE_ERROR, IMAGES_ERROR, MAX_ANGLE_SPREAD, MEMBER_FACTOR, OK, SHAPE_ERROR
from onboard.filters.kernels.sigma_points import wrapped


@kernel(**FILLING)
def centred_into(images, w, first, angular, mean, deviations):
    """Fill the mean (m,) of images (2n+1, m) and the deviations (m, 2n+1) from it; return a status.

    The 2n outer points have weight w; the status is IMAGES_ERROR if an image is not finite. Weights sum to one, so
    a mean relative to the centre's image needs no other weight, and a mean of angles does not break at +-pi. With
    `first` 1 there is no centre: the mean is relative to the first image, and then to that mean.
    """
    k, m = images.shape
    good, farthest = True, 0.0
    for a in range(m):
        origin = images[first, a]
        deviations[a, 0] = 0.0
        for sweep in range(1 + first):
            shift = 0.0
            for s in range(1, k):
                d = images[s, a] - origin
                if angular[a]:
                    d = wrapped(d)
                    farthest = max(farthest, abs(d))
                deviations[a, s] = d
                shift += d
            shift *= w
            if sweep < first:
                origin += shift
        for s in range(first, k):
            deviations[a, s] -= shift
        mean[a] = origin + shift
        good &= np.isfinite(mean[a])
    if not good:
        return IMAGES_ERROR
    return OK if farthest <= MAX_ANGLE_SPREAD else ANGLE_ERROR


@kernel(**FILLING)
def skips_centre(images, w_cov):
    """Return 1 if the centre's image has no weight and is not finite, so that it must be left out; else 0."""
    off = 0.0  # stays zero as long as all is finite
    for a in range(images.shape[1]):
        off += images[0, a] - images[0, a]
    return 1 if w_cov == 0 and off != 0 else 0


@kernel(signature(3, FLAGS), **MAKING)
def with_centre(images, angular):
    """Return (images (B, k+1, m), status): the mean of the images (B, k, m), and after it the images."""
    count, k, m = images.shape
    out = np.empty((count, k + 1, m))
    if angular.shape[0] != m:
        return out, SHAPE_ERROR
    mean, deviations = np.empty(m), np.empty((m, k + 1))
    for b in range(count):
        out[b, 1:] = images[b]
        status = centred_into(out[b], 1.0 / k, 1, angular, mean, deviations)
        if status == ANGLE_ERROR:  # callers find NaN
            return out, ANGLE_ERROR + MEMBER_FACTOR * b
        out[b, 0] = mean
    return out, OK


@kernel(signature(3, FLAGS), **MAKING)
def beside_first(images, angular):
    """Return (images (B, k, m), status): angles moved by whole turns to within pi of the first image's."""
    count, k, m = images.shape
    out = np.empty((count, k, m))
    if angular.shape[0] != m:
        return out, SHAPE_ERROR
    for b in range(count):
        for s in range(k):
            for a in range(m):
                out[b, s, a] = images[b, s, a]
                if angular[a]:
                    d = wrapped(images[b, s, a] - images[b, 0, a])
                    if abs(d) > MAX_ANGLE_SPREAD:
                        return out, ANGLE_ERROR + MEMBER_FACTOR * b
                    out[b, s, a] = images[b, 0, a] + d
    return out, OK

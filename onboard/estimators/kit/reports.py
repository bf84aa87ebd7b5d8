"""Construction of the published records that all estimators share."""

import math
from collections.abc import Sequence
from typing import Any

from onboard.arrays import Array
from onboard.filters.belief import Belief, Update
from onboard.messages import MeasurementReport, TargetImage, Verdict


def image_report(
    message: TargetImage,
    verdict: Verdict,
    *,
    components: Sequence[str],
    units: Sequence[str],
    gate: float | None,
    measured: Array | None = None,
    update: Update | None = None,
    **more: Any,
) -> MeasurementReport:
    """Return the report of an image, with everything known when the verdict was reached.

    `measured` is (m,); `update` is the filter's update by the image; `more` are further fields of the report.
    """
    return MeasurementReport(
        source=message.camera,
        t_ns=message.t_ns,
        t_recv_ns=message.t_recv_ns,
        verdict=verdict,
        components=tuple(components),
        units=tuple(units),
        gate=gate,
        points=message.image_points,
        measured=None if measured is None else tuple(measured.tolist()),
        **({} if update is None else update_fields(update)),
        **more,
    )


def update_fields(update: Update) -> dict[str, Any]:
    """Return the prediction and the innovation of an update, as fields of a report."""
    variances = update.innovation_covariance.diagonal().tolist()
    return {
        "predicted": tuple(update.predicted.tolist()),
        "innovation": tuple(update.innovation.tolist()),
        "innovation_sigma": tuple(map(math.sqrt, variances)),
        "nis": float(update.nis),
    }


def belief_fields(belief: Belief | None) -> dict[str, Any]:
    """Return the fields of an estimate that a belief determines; both None without one."""
    if belief is None:
        return {"mean": None, "covariance": None}
    return {
        "mean": tuple(belief.mean.tolist()),
        "covariance": tuple(map(tuple, belief.covariance.tolist())),
    }

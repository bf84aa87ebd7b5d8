"""What estimators publish alike: the report of an image, an update as fields of a report, a belief as fields of an
estimate."""

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
    """The report of an image, with as much as was known when the verdict was reached: `measured` (m,), and the
    filter's `update` by it; `more` are further fields of the report."""
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
        **({} if update is None else of_update(update)),
        **more,
    )


def of_update(update: Update) -> dict[str, Any]:
    """The fields of a report that an update gives: what was predicted, and by how much the measurement is off."""
    variances = update.innovation_covariance.diagonal().tolist()
    return {
        "predicted": tuple(update.predicted.tolist()),
        "innovation": tuple(update.innovation.tolist()),
        "innovation_sigma": tuple(map(math.sqrt, variances)),
        "nis": float(update.nis),
    }


def of_belief(belief: Belief | None) -> dict[str, Any]:
    """The fields of an estimate that a belief gives; both None without one."""
    if belief is None:
        return {"mean": None, "covariance": None}
    return {
        "mean": tuple(belief.mean.tolist()),
        "covariance": tuple(map(tuple, belief.covariance.tolist())),
    }

"""What is told of one image: what it measured, what was expected, and what became of it."""

import math
from typing import Any, NamedTuple

from onboard.estimators.leader.filter import LeaderFilter, View
from onboard.estimators.leader.image import Image
from onboard.filters.belief import Update
from onboard.messages import ImagePoint, MeasurementReport, TargetPoints, Verdict


class Outcome(NamedTuple):
    """What the filter, in state `prior`, made of an image from a view."""

    fused: bool
    update: Update
    prior: Any
    view: View


def report(
    filter_: LeaderFilter,
    message: TargetPoints,
    verdict: Verdict,
    image: Image | None = None,
    outcome: Outcome | None = None,
) -> MeasurementReport:
    """The report of a verdict, with as much as was known when it was reached."""
    told: dict[str, Any] = {}
    if image is not None:
        told["measured"] = tuple(image.seen.y.tolist())
    if image is not None and outcome is not None:
        update = outcome.update
        told |= {
            "predicted": tuple(update.predicted.tolist()),
            "innovation": tuple(update.innovation.tolist()),
            "innovation_sigma": tuple(map(math.sqrt, update.innovation_covariance.diagonal().tolist())),
            "nis": update.nis,
            "predicted_points": _expected(filter_, image, outcome),
        }
    return MeasurementReport(
        source=message.camera,
        t_ns=message.t_ns,
        t_recv_ns=message.t_recv_ns,
        verdict=verdict,
        components=filter_.seen_components,
        units=filter_.seen_units,
        gate=filter_.gate,
        points=(message.center, message.left, message.right),
        **told,
    )


def _expected(filter_: LeaderFilter, image: Image, outcome: Outcome) -> tuple[ImagePoint, ...] | None:
    """Where the points were expected, unless one was behind the camera."""
    points = filter_.expected(outcome.prior, image.seen, outcome.update, outcome.view).tolist()
    return tuple((u, v) for u, v in points) if all(math.isfinite(u + v) for u, v in points) else None

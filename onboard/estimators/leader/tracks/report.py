"""Published records of a target.

Reports on single images, with what was measured, what was predicted, and the verdict; the estimate; and how often.
"""

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from onboard.estimators.kit.reports import belief_fields, image_report
from onboard.estimators.leader.hypotheses.belief import BeliefFilter
from onboard.estimators.leader.hypotheses.places import Place
from onboard.estimators.leader.image.measurement import COMPONENTS, points_of
from onboard.estimators.leader.tracks.fusing import ImageRecord
from onboard.filters.belief import Belief
from onboard.messages import Estimate, MeasurementReport, Mode, Vec3, Verdict
from onboard.models.relative_motion import POSITION, VELOCITY
from onboard.ownship import Ownship
from onboard.units import NS_PER_S


def report(filter_: BeliefFilter, record: ImageRecord) -> MeasurementReport:
    """The report of an image, with as much as was known when its verdict was reached."""
    image, update = record.image, record.update
    more, count = dict[str, Any](), 0 if image is None else len(image.measurement.rows.y)
    if image is not None and update is not None:
        more = {"misfits": update.misfits, "noise_scale": image.noise_scale}
        points = points_of(image.measurement.axes, update.predicted)
        if all(math.isfinite(u + v) for u, v in points):  # none is behind the camera
            more["predicted_points"] = points
    return image_report(
        record.message,
        record.verdict or Verdict.NUMERICAL,
        components=COMPONENTS[:count],
        units=("rad",) * count,
        gate=filter_.gate,
        measured=None if image is None else image.measurement.rows.y,
        update=update,
        **more,
    )


def with_attitude(belief: Belief, stated: Vec3, known: Vec3) -> Belief:
    """A belief with the errors of our attitude that the autopilot states (3,) (about n's axes, rad, 1 sigma),
    where they are more than those that the filter knows of. They turn what is seen as a whole: no image shows it.
    """
    more = [max(s * s - k * k, 0.0) for s, k in zip(stated, known, strict=True)]
    if not any(more):
        return belief
    turns = np.zeros((len(belief.mean), 3))
    for part in (POSITION, VELOCITY):
        turns[part] = np.cross(np.eye(3), belief.mean[part]).T
    return belief._replace(covariance=belief.covariance + (turns * more) @ turns.T)


def modes_of(places: Iterable[Place]) -> tuple[Mode, ...]:
    """Places as records."""
    return tuple(Mode(weight=p.weight, **belief_fields(Belief(p.mean, p.covariance))) for p in places)


class RateLimit:
    """When a target's next estimate is due, so that there are `rate_hz` a second on average, those with an image
    included.

    Estimates are of the times of navigation samples: where these come every 20 ms, 30 images a second bring an
    estimate after 20 or 40 ms. So the next one is due an interval after the last one was due, not after it came.
    One that comes early postpones the next one by an interval at most.
    """

    def __init__(self, rate_hz: float) -> None:
        self._interval_ns = round(NS_PER_S / rate_hz)
        self._due_ns: int | None = None

    def published(self, t_ns: int) -> None:
        """An estimate of this time was published, with or without an image."""
        due_ns = t_ns if self._due_ns is None else self._due_ns
        counted_ns = min(max(due_ns, t_ns - self._interval_ns), t_ns + self._interval_ns)
        self._due_ns = counted_ns + self._interval_ns

    def is_due(self, t_ns: int) -> bool:
        """Whether to predict and publish at this time; also when time has gone back."""
        if self._due_ns is None:
            return True
        return not 0 < self._due_ns - t_ns <= 2 * self._interval_ns

    def clear(self) -> None:
        """Forget all times: the next estimate is due at once."""
        self._due_ns = None


def publish(belief: Belief | None, known: Vec3, limit: RateLimit, ownship: Ownship, **fields: Any) -> Estimate:
    """The estimate of a belief, None without a track, with its further `fields`.

    `known`: the errors of our attitude (3,) that the filter knows of. The next one is due by the `limit`."""
    limit.published(fields["t_ns"])
    if belief is not None:
        belief = with_attitude(belief, ownship.attitude_sigma, known)
    return Estimate(**fields, **belief_fields(belief))

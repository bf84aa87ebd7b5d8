"""Detections as separate messages, as exposures, and as updates, for tests that change them."""

from collections.abc import Iterable
from itertools import groupby

from onboard.estimators.leader.hypotheses.belief import BeliefFilter, State
from onboard.estimators.leader.image.camera_pose import CameraPose
from onboard.estimators.leader.image.measurement import Measurement
from onboard.filters.belief import Update
from onboard.messages import Exposure, Message, TargetImage


def exposed(messages: Iterable[Message]) -> list[Message]:
    """Messages in order, with neighbouring detections of one camera and time as one exposure."""
    out: list[Message] = []
    for _, group in groupby(messages, lambda m: (m.camera, m.t_ns) if isinstance(m, TargetImage) else None):
        found = list(group)
        seen = [m for m in found if isinstance(m, TargetImage)]
        out += [Exposure.of(*seen)] if seen else found
    return out


def detections(messages: Iterable[Message]) -> list[Message]:
    """Messages in order, with each exposure as its detections."""
    return [each for m in messages for each in (m.detections if isinstance(m, Exposure) else (m,))]


def fused(filter_: BeliefFilter, state: State, measurement: Measurement, pose: CameraPose) -> Update:
    """The update of a leader's filter by a measurement."""
    return filter_.fuse(filter_.compare(filter_.predict(state), measurement, pose))

"""Four kinds of flight with the leader's nose off its course, through the default pipeline.

A filter that assumes the nose on the course becomes sure of a wrong range. Before the cloud of noses the default
filter did so in 19 to 77 % of the estimates of these flights.
"""

from collections.abc import Callable
from itertools import count
from typing import Final

import msgspec
import numpy as np
import pytest

from onboard.arrays import Array
from onboard.config import load_config
from onboard.messages import Message, TargetPoints
from onboard.pipeline import Pipeline
from simlink.encounters import encounter as encounters
from simlink.encounters.encounter import BOOT_NS, make_encounter
from simlink.encounters.families import FAMILIES, Scene, steep
from studies.encounters.flights import estimated, judged, known
from studies.encounters.scores import Score, score
from tests.support.cases import slow_but
from tests.support.images import detections, exposed

DURATION_S: Final = 30.0
Change = Callable[[list[Message]], list[Message]]


def as_it_is(messages: list[Message]) -> list[Message]:
    return messages


def out_of_view(messages: list[Message]) -> list[Message]:
    """No image arrives from 12 to 18 s: the track is lost, and restarted with another nose."""
    begins, ends = (BOOT_NS + round(s * 1e9) for s in (12.0, 18.0))
    return [m for m in messages if not (isinstance(m, TargetPoints) and begins <= m.t_ns < ends)]


def exchanged() -> Change:
    """The wingtips exchange their names in every other image."""
    images = count()

    def change(messages: list[Message]) -> list[Message]:
        return [
            msgspec.structs.replace(m, left=m.right, right=m.left)
            if isinstance(m, TargetPoints) and next(images) % 2 == 0
            else m
            for m in messages
        ]

    return change


def flown(family: str, seed: int, change: Change, seconds: float = DURATION_S) -> Score:
    encounter = make_encounter(family, seed, seconds)
    pipeline = Pipeline(load_config(None, known(encounter)))
    return score(
        [
            judged(
                estimated(pipeline, encounter.datagrams(), lambda messages: exposed(change(detections(messages)))),
                encounter.truth,
            )
        ]
    )


FLIGHTS: Final = {
    "a track begun again": ("wander", 602, out_of_view),
    "exchanged wingtips": ("crossing", 601, exchanged()),
    "a nose from the front": ("head_on", 601, as_it_is),
    "a leader that stops, turns round and leaves": ("stop_turn_leave", 602, as_it_is),
}
LEAST_VALID: Final = {
    "a track begun again": 80.0
}  # percent: its images are missing for 6 of 25 s, and it coasts for 2

# percent: of one flight each, which draws more than is supposed
LEAST_INSIDE: Final = {"a nose from the front": 70.0, "a track begun again": 85.0}


@pytest.mark.parametrize("name", slow_but(["a nose from the front"], FLIGHTS))
def test_the_estimate_is_never_sure_of_a_wrong_range_seeds_601_and_602(name: str) -> None:
    found = flown(*FLIGHTS[name])
    assert found.wrong.percent == 0.0
    assert found.inside.percent > LEAST_INSIDE.get(name, 91.0)
    assert found.valid.percent > LEAST_VALID.get(name, 98.0)


def askew(rng: np.random.Generator, t: Array, vigour: float) -> Scene:
    """We see the leader 45 to 65 degrees above or below us, with its nose always 5 degrees off its course."""
    scene = steep(rng, t, vigour)
    course = np.unwrap(np.arctan2(scene.leader.v[:, 1], scene.leader.v[:, 0]))
    return scene._replace(nose=course + np.radians(5.0))


@pytest.mark.slow  # hypotheses/test_headings.py has what a nose off its course does in one step
@pytest.mark.parametrize("seed", [6, 9])  # of which the leader flies on
def test_a_nose_that_is_5_degrees_off_its_course_for_good_is_no_other_range_seeds_6_and_9(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """When tied noses were exactly on their courses, 35 and 21 % were confidently wrong."""
    monkeypatch.setattr(encounters, "FAMILIES", {**FAMILIES, "askew": askew})
    assert flown("askew", seed, as_it_is, 40.0).wrong.percent < 5.0

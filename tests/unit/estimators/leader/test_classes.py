"""What a detector takes a target for: the class of most images of the last seconds."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.estimators.leader.tracks.doubts import Classes
from onboard.messages import Lifecycle, TargetPoints
from tests.support.streams import MS, SIZE, Flight, Run, S, Stream, advance, make_config, position_nees

NEAR = Flight(radius=None, gap=25.0)
CONFIG = make_config(
    f"target.drone.size_prior_m={SIZE}",
    f"target.quad.size_prior_m={SIZE}",
    f"target.airplane.size_prior_m={10 * SIZE}",
    'target.airplane.leader_class="fixed_wing"',
)


def believed(names: Sequence[str]) -> tuple[list[str | None], list[str]]:
    """What is believed after each image, 40 ms apart, and what is open then; "bird" is not configured."""
    classes = Classes[str](memory_s=5.0)
    kinds, doubts = [], []
    for k, name in enumerate(names):
        classes.add(None if name == "bird" else name, name, k * 40 * MS)
        kinds.append(classes.kind)
        doubts.append("" if classes.doubt is None else classes.doubt.words)
    return kinds, doubts


def test_a_first_class_that_was_wrong_is_given_up_once_another_comes_twice_as_often() -> None:
    kinds, doubts = believed(["airplane"] * 10 + ["drone"] * 30)
    change = kinds.index("drone")
    assert 10 + 15 < change < 10 + 21
    assert set(kinds[:change]) == {"airplane"}
    assert doubts[15] == ""
    assert doubts[change - 1] == "the detector takes it now for airplane, now for drone"
    assert set(doubts[change:]) == {""}


def test_neither_a_few_images_nor_an_unknown_class_change_what_is_believed_seed_1() -> None:
    names = np.random.default_rng(1).choice(["drone", "bird", "airplane"], 300, p=[0.55, 0.3, 0.15]).tolist()
    kinds, doubts = believed(["drone"] * 5 + names)
    assert set(kinds) == {"drone"}
    assert set(doubts) == {""}
    assert set(believed(["bird"] * 30 + ["airplane"] + ["bird"] * 30)[0]) == {None}
    assert believed(["bird"] * 30 + ["drone"] * 20)[0][-1] == "drone"


def test_two_classes_by_turns_leave_it_open_for_as_long_as_they_do() -> None:
    kinds, doubts = believed(["drone", "airplane"] * 100)
    assert set(kinds) == {"drone"}
    assert all(doubts[10:])
    assert not any(doubts[:1])
    assert believed(["drone", "airplane"] * 20 + ["drone"] * 200)[1][-1] == ""


def flown(name_at: Callable[[float], str]) -> Run:
    """Six seconds with these classes, by the time in s."""
    messages = (item.message for item in Stream(flight=NEAR, t1=11.0, seed=1).items())
    return advance(
        [replace(m, class_name=name_at(m.t_ns / S)) if isinstance(m, TargetPoints) else m for m in messages],
        CONFIG,
    )


@pytest.mark.parametrize("first", ["airplane", "drone"])
def test_a_track_begins_anew_by_the_class_that_most_images_have_seed_1(first: str) -> None:
    run = flown(lambda t: first if t < 6.0 else "quad")  # which is as large as a drone
    changes = int(first == "airplane")
    assert run.pipeline.health(0).verdicts.get("leader.class_changed", 0) == changes
    words = [e.reason for e in run.estimates if e.reason == "the detector takes it for quad now"]
    assert len(words) == changes
    assert run.estimates[-1].reset_count == changes
    late = [e for e in run.estimates if e.t_ns > 9 * S]
    assert all(e.valid for e in late)
    assert max(position_nees(e, NEAR) for e in late) < 7.8


def test_a_track_whose_class_flickers_between_two_is_not_valid_seed_1() -> None:
    run = flown(lambda t: "drone" if round(t * 25) % 2 else "airplane")
    late = [e for e in run.estimates if e.t_ns > 6 * S]
    assert {e.state for e in late} == {Lifecycle.LOST}
    assert all(e.reason.startswith("the detector takes it now for ") for e in late)
    assert run.estimates[-1].reset_count == 0

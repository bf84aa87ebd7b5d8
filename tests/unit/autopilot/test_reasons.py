"""STATUSTEXTs that say why a vehicle is not led."""

from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.autopilot.leader_messages import CameraView
from onboard.autopilot.reasons import Reasons, edge_of
from onboard.geometry.camera import make_camera
from onboard.geometry.rotations import quaternion_from_euler
from onboard.messages import Cause, LeaderState
from tests.support.leader import S, leader_state, lost_state

CAMERA = make_camera(f_px=554.256, width_px=640, height_px=480)  # to 30 degrees aside, 23.4 up and down
BEGIN = [(6, "onboard has started")]


def view(pitch_deg: float = 0.0) -> CameraView:
    w, x, y, z = quaternion_from_euler(0.0, np.radians(pitch_deg), 0.0).tolist()
    return CameraView((w, x, y, z), CAMERA, is_px4=False)


def texts(
    reasons: Reasons, state: LeaderState | None, seconds: float, start: float = 0.0
) -> list[tuple[float, str]]:
    """(s, text) of what is sent, looked at every 50 ms."""
    found = []
    for k in range(round(seconds * 20)):
        t = start + k / 20
        found += [(t, text) for _, text in reasons.tick(state, view(), round(1000 * S + t * S))]
    return found


def test_why_it_is_not_led_as_usual_is_sent_at_once_and_again_after_a_while() -> None:
    reasons, found = Reasons(), []
    for k in range(700):
        why = "range unsure" if 20 <= k < 660 else ""
        made = reasons.tick(leader_state(), view(), 1000 * S + k * S // 20, warning=why)
        found += [(k / 20, text) for _, text in made]
    assert found == [(0.0, BEGIN[0][1]), (1.0, "range unsure"), (31.0, "range unsure")]


def test_no_leader_is_said_with_its_reason_and_again_when_that_changes() -> None:
    reasons = Reasons()
    reasons.tick(None, None, 999 * S)
    sent = texts(reasons, lost_state(), 50.0)
    # counted from the first look, a second earlier
    assert sent == [(4.0, "no leader: no image fused lately"), (34.0, "no leader: no image fused lately")]
    assert texts(reasons, None, 6.0, 50.0)[0][1].startswith("no leader: nothing is estimated: no images")
    assert texts(reasons, leader_state(), 1.0, 60.0) == []


def test_words_that_change_with_one_cause_are_not_sent_again_and_another_cause_is() -> None:
    """Two of four images, three of four: one line; that none fits is another."""
    reasons, found = Reasons(), list[str]()
    reasons.tick(None, None, 999 * S)
    for k in range(240):
        of = Cause.STARTING if k < 140 else Cause.NOISE
        state = replace(lost_state(), cause=of, reason=f"{k} of 4 images")
        found += [text for _, text in reasons.tick(state, None, 999 * S + k * S // 10)]
    assert found == ["no leader: 50 of 4 images", "no leader: 140 of 4 images"]


@pytest.mark.parametrize(
    ("r_FL_n", "pitch_deg", "words"),
    [
        ((30.0, 0.0, 0.0), -30.0, "top edge by 7 deg"),
        ((30.0, 0.0, 0.0), 30.0, "bottom edge by 7 deg"),
        ((30.0, 30.0, 0.0), 0.0, "right edge by 15 deg"),
        ((30.0, -30.0, 0.0), 0.0, "left edge by 15 deg"),
        ((-30.0, 0.0, 0.0), 0.0, "behind the camera"),
        ((30.0, 10.0, 5.0), 0.0, ""),
    ],
)
def test_the_edge_of_the_image_is_named(r_FL_n: Any, pitch_deg: float, words: str) -> None:
    assert edge_of(leader_state(r_FL_n=r_FL_n), view(pitch_deg)) == words


def test_a_leader_that_leaves_the_image_is_said_once() -> None:
    reasons = Reasons()
    reasons.tick(None, None, 999 * S)
    inside, above = leader_state(age=0.9), leader_state(age=0.9, r_FL_n=(30.0, 0.0, -20.0))
    assert texts(reasons, leader_state(age=0.1, r_FL_n=(30.0, 0.0, -20.0)), 1.0) == []  # images still come
    assert texts(reasons, above, 3.0, 1.0) == [(1.0, "leader out of view: top edge by 10 deg")]
    assert texts(reasons, inside, 1.0, 5.0) == []
    assert len(texts(reasons, above, 3.0, 6.0)) == 1


def test_a_warning_comes_again_when_the_mode_is_entered() -> None:
    reasons, found = Reasons(), []
    for k in range(100):
        made = reasons.tick(leader_state(), view(), 1000 * S + k * S // 20, warning="passes", is_entered=k >= 50)
        found += [(k / 20, text) for _, text in made]
    assert found == [(0.0, BEGIN[0][1]), (0.0, "passes"), (2.5, "passes")]


def test_our_own_motion_is_not_doubted_aloud_before_the_vehicle_is_armed() -> None:
    """The attitude of an ArduCopter contradicts its rates while its filter aligns: in 7 of 7 starts."""
    words = "our own motion is in doubt: attitude contradicts"
    doubt = replace(lost_state(), cause=Cause.OWN_MOTION_DOUBT, reason=words)
    said = []
    for armed in (False, True):
        reasons = Reasons()
        reasons.tick(doubt, None, 1000 * S, is_armed=armed)
        said.append([text for _, text in reasons.tick(doubt, None, 1010 * S, is_armed=armed)])
    assert said == [[], [f"no leader: {words}"]]

"""Why a vehicle is not led, or stops, in words: for the pilot as STATUSTEXT, and for the console.

The pilot sees a vehicle that hovers, and not why. Each text is short enough for one STATUSTEXT where it can be.
"""

import math
from typing import Final

import numpy as np

from onboard.autopilot.leader_messages import CameraView
from onboard.autopilot.notices import INFO, WARNING
from onboard.geometry.camera import in_view, project
from onboard.geometry.rotations import matrix_from_quaternion
from onboard.messages import LeaderState
from onboard.messages.causes import Cause, Reason
from onboard.units import NS_PER_S

Text = tuple[int, str]  # MAV_SEVERITY and the words

REASON_AFTER_NS: Final = 5 * NS_PER_S  # without a leader before the reason is sent
REASON_AGAIN_NS: Final = 30 * NS_PER_S  # before the same is sent again
NOTHING_ESTIMATED: Final = Reason(Cause.NO_MEASUREMENT, "nothing is estimated: no images, or no own motion")
UNSEEN_S: Final = 0.5  # without an image: the predicted leader may have left the view


class Reasons:
    """Reasons that have changed since the last tick."""

    def __init__(self) -> None:
        self._start_ns: int | None = None
        self._no_leader_ns: int | None = None  # since when there has been no leader, or when that was sent
        self._said: Cause | None = None
        self._warned, self._warned_ns = "", 0
        self._is_entered = False
        self._edge = ""

    def tick(
        self,
        state: LeaderState | None,
        view: CameraView | None,
        now_ns: int,
        *,
        warning: str = "",
        is_entered: bool = False,
        is_armed: bool = True,
    ) -> list[Text]:
        """What is to be sent at a time on this computer's clock. `state`: the leader; None before an estimate.
        `warning`: why the vehicle is not led as usual; it is said again when the mode is entered
        (`is_entered`). What our own motion contradicts before the vehicle `is_armed`, while its filter aligns,
        is not said."""
        texts: list[Text] = []
        if self._start_ns is None:
            self._start_ns = now_ns
            texts.append((INFO, "onboard has started"))
        if is_entered and not self._is_entered:
            self._warned = ""
        self._is_entered = is_entered
        texts += self._warning(warning, now_ns)
        if state is None or not state.valid:
            return texts + self._without_leader(state, now_ns, is_armed)
        self._no_leader_ns = self._said = None
        return texts + self._out_of_view(state, view)

    def _without_leader(self, state: LeaderState | None, now_ns: int, is_armed: bool) -> list[Text]:
        """Why there is none, once it has lasted, and again when the cause changes or a while has passed."""
        if self._no_leader_ns is None:
            self._no_leader_ns = now_ns
        why = NOTHING_ESTIMATED if state is None else Reason(state.cause, state.reason)
        waited_ns = now_ns - self._no_leader_ns
        if why.cause is Cause.OWN_MOTION_DOUBT and not is_armed:
            return []
        if waited_ns < (REASON_AGAIN_NS if why.cause is self._said else REASON_AFTER_NS):
            return []
        self._no_leader_ns, self._said = now_ns, why.cause
        return [(WARNING, f"no leader: {why.words}")]

    def _warning(self, warning: str, now_ns: int) -> list[Text]:
        """A new one, or one that has lasted."""
        if not warning or (warning == self._warned and now_ns - self._warned_ns < REASON_AGAIN_NS):
            return []
        self._warned, self._warned_ns = warning, now_ns
        return [(WARNING, warning)]

    def _out_of_view(self, state: LeaderState, view: CameraView | None) -> list[Text]:
        """Over which edge of the image the leader has gone, by the prediction."""
        edge = ""
        if view is not None and state.age is not None and state.age > UNSEEN_S:
            edge = edge_of(state, view)
        before, self._edge = self._edge, edge
        is_new = bool(edge) and edge.split()[:2] != before.split()[:2]
        return [(WARNING, f"leader out of view: {edge}")] if is_new else []


def edge_of(state: LeaderState, view: CameraView) -> str:
    """Beyond which edge of the image the predicted leader is, and by how many degrees; "" if it is inside."""
    camera = view.camera
    if state.r_FL_n is None or camera.gimbal is not None:
        return ""
    r_b = matrix_from_quaternion(view.q_nb).T @ np.array(state.r_FL_n)
    x, y, z = (camera.R_bc.T @ (r_b - camera.r_FC_b)).tolist()
    if x <= 0.0:
        return "behind the camera"
    if in_view(project(np.array([x, y, z])), camera):
        return ""
    aside, high = math.atan2(y, x), math.atan2(z, x)
    left, upper, right, lower = map(math.atan, camera.edges)
    beyond = {
        "left edge": left - aside,
        "top edge": upper - high,
        "right edge": aside - right,
        "bottom edge": high - lower,
    }
    edge = max(beyond, key=lambda name: beyond[name])
    return f"{edge} by {math.degrees(beyond[edge]):.0f} deg"

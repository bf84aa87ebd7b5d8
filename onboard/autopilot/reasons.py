"""Why a vehicle is not led, or stops, as text for the pilot (STATUSTEXT) and the console.

Each text fits into one STATUSTEXT where possible.
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

REASON_DELAY_NS: Final = 5 * NS_PER_S  # without a leader
REASON_PERIOD_NS: Final = 30 * NS_PER_S  # of the same reason
NOTHING_ESTIMATED: Final = Reason(Cause.NO_MEASUREMENT, "nothing is estimated: no images, or no own motion")
MAX_IMAGE_AGE_S: Final = 0.5  # of a leader that is taken to be in view


class Reasons:
    """Reasons that were sent, and when."""

    def __init__(self) -> None:
        self._start_ns: int | None = None
        self._no_leader_ns: int | None = None  # since when there has been no leader, or when that was sent
        self._sent_cause: Cause | None = None
        self._sent_warning, self._sent_warning_ns = "", 0
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
        """Return the texts to send now (this computer's clock).

        `state`: the leader, None before an estimate. `warning`: guidance's, sent again when the mode is entered.
        Doubts about our own motion are not sent before the vehicle is armed, while its filter aligns."""
        texts: list[Text] = []
        if self._start_ns is None:
            self._start_ns = now_ns
            texts.append((INFO, "onboard has started"))
        if is_entered and not self._is_entered:
            self._sent_warning = ""
        self._is_entered = is_entered
        texts += self._warning_text(warning, now_ns)
        if state is None or not state.valid:
            return texts + self._no_leader_text(state, now_ns, is_armed)
        self._no_leader_ns = self._sent_cause = None
        return texts + self._out_of_view_text(state, view)

    def _no_leader_text(self, state: LeaderState | None, now_ns: int, is_armed: bool) -> list[Text]:
        """Return the reason after a delay, when its cause changes, and periodically."""
        if self._no_leader_ns is None:
            self._no_leader_ns = now_ns
        why = NOTHING_ESTIMATED if state is None else Reason(state.cause, state.reason)
        waited_ns = now_ns - self._no_leader_ns
        if why.cause is Cause.OWN_MOTION_DOUBT and not is_armed:
            return []
        if waited_ns < (REASON_PERIOD_NS if why.cause is self._sent_cause else REASON_DELAY_NS):
            return []
        self._no_leader_ns, self._sent_cause = now_ns, why.cause
        return [(WARNING, f"no leader: {why.words}")]

    def _warning_text(self, warning: str, now_ns: int) -> list[Text]:
        """Return a warning that is new, or is due again."""
        if not warning or (warning == self._sent_warning and now_ns - self._sent_warning_ns < REASON_PERIOD_NS):
            return []
        self._sent_warning, self._sent_warning_ns = warning, now_ns
        return [(WARNING, warning)]

    def _out_of_view_text(self, state: LeaderState, view: CameraView | None) -> list[Text]:
        """Return a text if the predicted leader has just left the image over an edge."""
        edge = ""
        if view is not None and state.age is not None and state.age > MAX_IMAGE_AGE_S:
            edge = edge_of(state, view)
        before, self._edge = self._edge, edge
        is_new = bool(edge) and edge.split()[:2] != before.split()[:2]
        return [(WARNING, f"leader out of view: {edge}")] if is_new else []


def edge_of(state: LeaderState, view: CameraView) -> str:
    """Return the edge of the image beyond which the leader is, and the angle; "" if inside."""
    camera = view.camera
    if state.r_FL_n is None or camera.gimbal is not None:
        return ""
    r_b = matrix_from_quaternion(view.q_nb).T @ np.array(state.r_FL_n)
    x, y, z = (camera.R_bc.T @ (r_b - camera.r_FC_b)).tolist()
    if x <= 0.0:
        return "behind the camera"
    if in_view(project(np.array([x, y, z])), camera):
        return ""
    aside, below = math.atan2(y, x), math.atan2(z, x)
    left, upper, right, lower = map(math.atan, camera.edges)
    beyond = {
        "left edge": left - aside,
        "top edge": upper - below,
        "right edge": aside - right,
        "bottom edge": below - lower,
    }
    edge = max(beyond, key=lambda name: beyond[name])
    return f"{edge} by {math.degrees(beyond[edge]):.0f} deg"

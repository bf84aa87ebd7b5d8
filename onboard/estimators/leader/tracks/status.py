"""The life cycle of a track: its state, from when images were fused and gated.

    searching -> initialising (images must agree) -> tracking -> coasting -> lost -> tracking, or forgotten

Only a track that is tracking or coasting is valid.
"""

import math

from onboard.estimators.leader.config import Config
from onboard.geometry.units import NS_PER_S
from onboard.messages import Lifecycle


class Status:
    """When an image was last fused, since when all images are gated, and how many images a lost track still has to
    fuse before it is valid again. `images` must agree before a track starts."""

    def __init__(self, config: Config, images: int, reason: str) -> None:
        self.last_fused_ns: int | None = None
        self._last_wing_ns: int | None = None  # the newest fused image that shows the wing, and so the range
        self.resets = 0
        self.reason = reason  # why there is no track
        self._config, self._images = config, images
        self._gated_since_ns: int | None = None
        self._to_agree = 0
        self._state_since: tuple[Lifecycle, int] | None = None

    def started(self, t_ns: int, *, again: bool) -> None:
        """A track starts with an image of this time, `again` if it replaces another."""
        self.last_fused_ns = self._last_wing_ns = t_ns
        self._gated_since_ns, self._to_agree = None, 0
        self.resets += again

    def fused(self, t_ns: int, *, was_lost: bool, has_wing: bool) -> None:
        """The gate let a new image pass. The gate of a lost track is wide: one image proves nothing, and one
        without the wing nothing at all."""
        self._gated_since_ns = None
        self.last_fused_ns = max(self.last_fused_ns or 0, t_ns)
        if not has_wing:
            return
        self._last_wing_ns = max(self._last_wing_ns or 0, t_ns)
        if was_lost:
            self._to_agree = self._images
        self._to_agree = max(self._to_agree - 1, 0)

    def gated(self, t_ns: int) -> bool:
        """The gate stopped a new image. Whether nothing has passed it for too long, so that the track must end."""
        if self._to_agree:
            self._to_agree = self._images
        if self._gated_since_ns is None:
            self._gated_since_ns = t_ns
            return False
        return t_ns - self._gated_since_ns > self._config.relock_after_s * NS_PER_S

    def judged_again(self, fused_ns: int | None) -> None:
        """The history was computed again; `fused_ns` is the time of the newest image that the gate lets pass now,
        perhaps one that it stopped at first."""
        if fused_ns is not None and fused_ns > (self.last_fused_ns or 0):
            self.last_fused_ns = fused_ns
            self._gated_since_ns = None

    def forgotten(self, reason: str, *, had_track: bool) -> None:
        """The track, if there was one, has ended."""
        self.resets += had_track
        self.last_fused_ns = self._last_wing_ns = self._gated_since_ns = None
        self._to_agree = 0
        self.reason = reason

    def age(self, t_ns: int) -> float:
        """Seconds since the newest fused image; infinity without one."""
        return math.inf if self.last_fused_ns is None else (t_ns - self.last_fused_ns) / NS_PER_S

    def is_coasting(self, t_ns: int) -> bool:
        """Whether the last fused image is so old that the track is no longer tracking."""
        return self.age(t_ns) > self._config.coast_after_s

    def is_lost(self, t_ns: int) -> bool:
        """Whether the last fused image is so old that the track is no longer valid."""
        return self.age(t_ns) > self._config.validity_timeout_s or self._has_only_directions(t_ns)

    def _has_only_directions(self, t_ns: int) -> bool:
        """Whether no image has shown the range for so long that it is no longer known."""
        wing_ns = self._last_wing_ns
        return wing_ns is not None and t_ns - wing_ns > self._config.direction_timeout_s * NS_PER_S

    def is_over(self, t_ns: int) -> bool:
        """Whether the last fused image is so old that the track must be forgotten."""
        return self.age(t_ns) > self._config.reset_timeout_s

    def state(self, t_ns: int, *, in_view: bool) -> tuple[Lifecycle, str]:
        """The state of a track and its reason; `in_view`: whether the target should be in the image."""
        where = "" if in_view else ", and it should be outside the view"
        if self._to_agree:
            return Lifecycle.LOST, f"seen again: {self._to_agree} more images must agree"
        if self._has_only_directions(t_ns):
            return Lifecycle.LOST, f"no image has shown the wing, and so the range, for too long{where}"
        if not self.is_coasting(t_ns):
            return Lifecycle.TRACKING, "images fused"
        if not self.is_lost(t_ns):
            return Lifecycle.COASTING, f"no image fused lately: predicted{where}"
        return Lifecycle.LOST, f"no image fused within the validity timeout{where}"

    @property
    def latest(self) -> Lifecycle:
        """The state that was asked for last."""
        return Lifecycle.SEARCHING if self._state_since is None else self._state_since[0]

    def since(self, state: Lifecycle, t_ns: int) -> int:
        """When this state, the one at t_ns, began."""
        if self._state_since is None or self._state_since[0] is not state:
            self._state_since = state, t_ns
        return self._state_since[1]

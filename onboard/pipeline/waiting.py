"""Images that wait until our own pose at their time is known."""

from collections import Counter
from collections.abc import Mapping
from typing import Final

from onboard.config import OwnshipConfig
from onboard.messages import Exposure, Message
from onboard.ownship import Ownship
from onboard.units import NS_PER_S

MAX_WAITING_COUNT: Final = 256  # of each source
GIMBAL_TIMEOUT_NS: Final = 350_000_000  # an image waits so long for the attitude of its camera's gimbal
FIRST: Final = ("leader", "")  # targets whose images have room of their own; "" is a target without an id


class Waiting:
    """Messages stamped ahead of our own motion, in the order of arrival.

    A camera's clock may lead (in some recordings by half a second), and a gimbal's attitude may be rare, so images
    wait for them. `gimbals` holds each camera's gimbal; a camera without a known name has that of the first."""

    def __init__(self, config: OwnshipConfig, gimbals: Mapping[str, int | None]) -> None:
        self._gimbals, self._first_gimbal = gimbals, next(iter(gimbals.values()))
        self._longest_ns = config.max_lead_s * NS_PER_S
        self._extrapolated_ns = config.max_extrapolation_s * NS_PER_S
        self._waiting: list[Message] = []
        self._places: Counter[tuple[type[Message], bool]] = Counter()  # taken, by source

    def __len__(self) -> int:
        return len(self._waiting)

    def takes(self, image: Message, ownship: Ownship) -> bool:
        """Whether an image waits: our own motion at its time is not known yet, but may soon be. Attitude and
        position come in streams of their own, and either may be the one that is missing."""
        source = _source(image)
        if not (self._awaits_own_motion(image, ownship) or self._awaits_gimbal(image, ownship)):
            return False
        if self._places[source] >= MAX_WAITING_COUNT:
            return False
        self._waiting.append(image)
        self._places[source] += 1
        return True

    def ready(self, ownship: Ownship) -> list[Message]:
        """The images that need not wait any more, and do not."""
        if not self._waiting:
            return []
        ready: list[Message] = []
        waiting: list[Message] = []
        known_ns = ownship.known_ns
        for image in self._waiting:
            (ready if self._is_ready(image, known_ns, ownship) else waiting).append(image)
        if ready:
            self._waiting = waiting
            self._places = Counter(map(_source, waiting))
        return ready

    def clear(self) -> None:
        """Forget all images."""
        self._waiting.clear()
        self._places.clear()

    def _is_ready(self, image: Message, known_ns: float, ownship: Ownship) -> bool:
        """Whether our motion at its time is known, or has not become so for too long: a stream has stopped."""
        is_known = image.t_ns <= known_ns and not self._awaits_gimbal(image, ownship)
        return is_known or ownship.now_ns - image.t_ns > self._longest_ns

    def _awaits_own_motion(self, image: Message, ownship: Ownship) -> bool:
        """Whether the image is well ahead of all that we know of our motion, or so far ahead of attitude or
        position that its pose is not known."""
        if ownship.now_ns <= 0:
            return False
        ahead_ns, lead_ns = image.t_ns - ownship.now_ns, ownship.lead_ns(image.t_ns)
        is_ahead = self._longest_ns >= ahead_ns > 0.5 * self._extrapolated_ns
        return is_ahead or self._longest_ns >= lead_ns > self._extrapolated_ns

    def _awaits_gimbal(self, image: Message, ownship: Ownship) -> bool:
        """Whether an image is of a camera on a gimbal, whose attitude at its time may come soon."""
        if not isinstance(image, Exposure) or image.detections[0].mount is not None:
            return False
        gimbal = self._gimbals.get(image.camera, self._first_gimbal)
        may_come = gimbal is not None and ownship.gimbals.may_know(gimbal, image.t_ns)
        return may_come and ownship.now_ns - image.t_ns <= GIMBAL_TIMEOUT_NS


def _source(message: Message) -> tuple[type[Message], bool]:
    """Whose room a message takes while it waits: other targets never cost the leader's images their place."""
    first = isinstance(message, Exposure) and any(seen.target in FIRST for seen in message.detections)
    return type(message), first

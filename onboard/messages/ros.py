"""Output to ROS 2: its configuration, topics, and messages as bytes."""

import re
from typing import Annotated, Final, Literal, NamedTuple

import msgspec

from onboard.messages.base import Positive, Record

TOPIC_PATTERN: Final = re.compile(r"[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)  # without the first slash
FRAME_ID_PATTERN: Final = re.compile(r"[\w/-]*", re.ASCII)


class Ros2Config(Record, frozen=True, kw_only=True):
    """Configuration `[ros2]`: output over rmw_zenoh (`enabled`), or in a bag of `onboard replay`.

    Raises ValueError for a name that ROS does not accept.
    """

    enabled: bool = False
    domain: Annotated[int, msgspec.Meta(ge=0, le=232)] = 0  # ROS_DOMAIN_ID
    distribution: Literal["humble", "jazzy"] = "jazzy"  # jazzy includes later ones; Humble has no type hashes
    namespace: str = "onboard"  # before each topic but /tf and /diagnostics
    frame_prefix: str = ""  # before each frame but `map`, such as "uav1/"
    rate_hz: Positive = 30.0  # maximum rate of each topic in flight
    tf: Literal["map", "base_link", "none"] = (
        "map"  # root of the /tf tree; base_link: another node publishes its motion
    )

    def __post_init__(self) -> None:
        if not TOPIC_PATTERN.fullmatch(self.namespace):
            raise ValueError(
                f"namespace {self.namespace!r}: letters, digits and _ only, with / between parts and not before"
                ' the first, such as "onboard" or "uav1/onboard"'
            )
        if not FRAME_ID_PATTERN.fullmatch(self.frame_prefix):
            raise ValueError(
                f'frame_prefix {self.frame_prefix!r}: letters, digits, _, - and / only, such as "uav1/"'
            )


class RosTopic(NamedTuple):
    """A topic with its first slash, its type as `package/msg/Name`, and the type's hash.

    The hash is `RIHS01_...`.
    """

    name: str
    kind: str
    type_hash: str


class RosMessage(NamedTuple):
    """A message in CDR, and the time in its header, ns."""

    topic: RosTopic
    t_ns: int
    data: bytes

"""Needs of a configuration, and the moment at which causes are judged."""

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from onboard.messages import Exposure, Health
from onboard.units import S_PER_NS

SILENCE_TIMEOUT_S: Final = 3.0
RATE_SHARE: Final = 0.8  # of a rate that is needed
MOTION_STREAMS: Final = ("Attitude", "LocalPosition")


class LinkNeed(NamedTuple):
    """A configured link: its name and link string, whether an autopilot is at its other end, and its key's
    file."""

    name: str
    url: str
    is_autopilot: bool
    key_file: str | None


class Needs(NamedTuple):
    """Requirements of a configuration.

    `prefix`: the beginning of our Zenoh keys, "" without Zenoh. `system`: the only MAVLink system that may be
    followed, 0 for any. `rates`: Hz that each stream (by its record) must have;
    `asked`: Hz that are asked for, by MAVLink name. `images`: an estimator needs images. `classes`: of targets,
    that have a section. `undistorted`: names of cameras without distortion coefficients; `ros`: of those whose
    images come over ROS. `sends_places`: links on which the leader's place on Earth is sent.
    `transponder`: the address of our own is known."""

    prefix: str = ""
    system: int = 0
    links: tuple[LinkNeed, ...] = ()
    cameras: tuple[str, ...] = ()
    rates: Mapping[str, float] = {}
    asked: Mapping[str, float] = {}
    images: bool = False
    classes: tuple[str, ...] = ()
    undistorted: tuple[str, ...] = ()
    ros: tuple[str, ...] = ()
    sends_places: tuple[str, ...] = ()
    transponder: bool = False


class Moment(NamedTuple):
    """Inputs of the checks for causes.

    They are the health now and some seconds before, the requirements, the time (s) that the daemon has waited for
    them, and the time (its clock, ns) at which the daemon was found to have stalled, 0 if never. `recent` holds
    the healths from `before` on, oldest first."""

    now: Health
    before: Health
    needs: Needs
    waited: float
    stood_ns: int = 0
    recent: Sequence[Health] = ()

    def since(self, age: float) -> Health:
        """The oldest health that is younger than `age` s, so that what is counted since then is no older."""
        young = (h for h in self.recent if (self.now.t_recv_ns - h.t_recv_ns) * S_PER_NS < age)
        return next(young, self.now)

    def rejected(self, counted: str) -> int:
        """Messages of the last seconds that were counted as rejected."""
        return self.now.rejected.get(counted, 0) - self.before.rejected.get(counted, 0)

    def verdicts(self, name: str) -> int:
        """Verdicts of the last seconds, as `leader.gated`."""
        return self.now.verdicts.get(name, 0) - self.before.verdicts.get(name, 0)

    @property
    def is_heard(self) -> bool:
        """Whether the autopilot is heard now."""
        return self.now.followed != "" and self.silence < SILENCE_TIMEOUT_S

    @property
    def silence(self) -> float:
        """Seconds since any stream of our vehicle."""
        own = [s.age for name, s in self.now.streams.items() if name != Exposure.__name__]
        return min(own, default=self.waited)

    @property
    def has_just_come(self) -> bool:
        """Whether the autopilot was not heard all the last seconds, so that its rates are not known yet."""
        heartbeat = self.before.streams.get("Heartbeat")
        return self.now is self.before or heartbeat is None or heartbeat.age > SILENCE_TIMEOUT_S

    def rate(self, name: str) -> float:
        """A stream's rate now, Hz. Where there is no local position, the global one is used."""
        names = ("LocalPosition", "GlobalPosition") if name == "LocalPosition" else (name,)
        return max(self.now.streams[n].rate if n in self.now.streams else 0.0 for n in names)

    @property
    def has_motion(self) -> bool:
        """Whether our own motion comes as often as it must."""
        return all(self.rate(name) >= RATE_SHARE * self.needs.rates.get(name, 0.0) for name in MOTION_STREAMS)

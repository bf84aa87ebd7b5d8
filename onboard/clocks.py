"""One time base: the autopilot's boot clock, in nanoseconds.

Each message leaves here with `t_ns` = when it was true on that clock: its stamp less the known delay of its
source (in field data, a LOCAL_POSITION_NED was 20-25 ms older than its stamp). Stamps of this computer's clock
(camera, Unix time) are converted by the offset between the two clocks. It comes from TIMESYNC where there are
replies, else from the fastest of the messages: the lower envelope of arrival minus stamp. While a link is held up,
even its fastest messages are late, so the envelope rises no faster than clocks drift apart.

A stamp that does not fit is compared with its neighbours. When the boot clock runs on and only the arrival time
has jumped, our own clock was set or the link is held up, and nothing is lost. Where arrivals are stamped by a
clock that can be set, it was set if they stay late. When the boot clock itself has jumped, and the next few
messages agree, the autopilot has rebooted. A single odd stamp is rejected, and so is one that is farther ahead of
its arrival than the link has shown. Only the autopilot's own stamps are judged so: a camera's may lead or lag, and
say nothing about the autopilot's clock.
"""

from collections import Counter
from typing import Final

import msgspec

from onboard.messages import (
    ActuatorOutputs,
    Clock,
    GimbalAttitude,
    Message,
    PeerRanges,
    RadarScan,
    TargetImage,
    TimeSync,
)

SENSED: Final = (TargetImage, RadarScan, PeerRanges)  # whose stamps may be of the boot clock
SERVO_WRAP_NS: Final = 2**32 * 1000  # SERVO_OUTPUT_RAW stamps in 32 bits of microseconds: 71.6 minutes
BOOT_WRAP_NS: Final = 2**32 * 1_000_000  # time_boot_ms: 49.7 days
JUMP_NS: Final = 1_000_000_000
CONTINUES_NS: Final = 5_000_000_000
CONFIRM: Final = 5
STEP_SEEN_NS: Final = 2_000_000_000  # so long after a step of the wall clock, stamps from before it may arrive
CONFIRM_TAGGED: Final = 3
WINDOW_NS: Final = 10_000_000_000
DRIFT: Final = 300e-6  # the most by which two clocks drift apart; simulated autopilots: 150e-6
AHEAD_NS: Final = 250_000_000  # of a stamp before its arrival; streams of one real autopilot are 140 ms apart
STEP_LASTS_NS: Final = 3_000_000_000  # a link that is held up for longer is taken for a clock that was set
CORRECTED_NS: Final = 50_000_000  # stamps of this computer were converted so wrongly that estimates suffer
MOST_GIMBALS: Final = 8
LONGEST_ROUND_TRIP_NS: Final = 200_000_000


class Clocks:
    """The offset host clock - boot clock, and the boot clock's continuity. All times in ns. `rejected` counts by
    reason the messages and replies that could not be used."""

    def __init__(self) -> None:
        self.reboots = 0
        self.corrections = 0  # of the offset: stamps of this computer had been converted wrongly
        self.rejected: Counter[str] = Counter()
        self.restart()

    def restart(self) -> None:
        """Forget the time base, but not the counts: another autopilot is followed."""
        self._wall_steps: list[tuple[int, int]] = []  # (since which arrival, wall clock - arrivals' clock)
        self._is_even = False  # whether the clock of arrivals is never set
        self._latency_ns: dict[type[Message], int] = {}  # of the last message that this computer stamped
        self.source = "none"
        self.round_trip_ns: int | None = None
        self._newest_stamp: int | None = None
        self._last_arrival = 0
        self._base = 0  # host - boot as it was at the last message: coarse, for continuity only
        self._odd: list[int] = []  # offsets of recent stamps that did not fit
        self._tagged: list[int] = []  # arrivals of the last replies with our tag
        self._own_replies = False
        self._fastest: list[tuple[int, int]] = []  # (t_recv, host - boot), the lower envelope, the lowest first
        self._gimbals: dict[tuple[int, int], list[tuple[int, int]]] = {}  # the same, of each gimbal's own clock
        self._late_since: int | None = None  # arrival since which messages are late by a second or more
        self._used: int | None = None  # the offset by which a stamp of this computer was converted last
        self._synced: list[tuple[int, int, int]] = []  # (round trip, t_recv, host - boot)

    @property
    def offset_ns(self) -> int | None:
        """Host clock minus boot clock, None before the first message."""
        if self._synced:
            return min(self._synced)[2]
        return self._fastest[0][1] if self._fastest else None

    @property
    def late_ns(self) -> int:
        """By how much more than the fastest the last message was late; 0 where arrivals are stamped by a clock
        that may have been set."""
        offset = self.offset_ns
        return self._base - offset if self._is_even and offset is not None else 0

    def align(self, message: Message, delay_ns: int = 0) -> Message | None:
        """The message with `t_ns` on the boot clock, less its delay; None, and counted, where that is unknown."""
        t_ns = message.t_ns
        if isinstance(message, GimbalAttitude):
            return self._align_gimbal(message)
        if message.clock is Clock.BOOT:
            if isinstance(message, SENSED):
                if self._newest_stamp is None:
                    self.rejected["no_time_base"] += 1
                    return None
                return msgspec.structs.replace(message, t_ns=self._unwrapped(t_ns, message.t_recv_ns) - delay_ns)
            if isinstance(message, ActuatorOutputs) and self._newest_stamp is not None:
                t_ns += round((self._newest_stamp - t_ns) / SERVO_WRAP_NS) * SERVO_WRAP_NS
            t_ns = self._unwrapped(t_ns, message.t_recv_ns)
            if not self._continues(t_ns, message.t_recv_ns):
                return None
        else:
            offset = self.offset_ns
            if offset is None:
                self.rejected["no_time_base"] += 1
                return None
            if self._is_even and self._used is not None and abs(offset - self._used) > CORRECTED_NS:
                self.corrections += 1
            self._used = offset
            t_ns = self._unset(message) - offset
        return msgspec.structs.replace(message, t_ns=t_ns - delay_ns, clock=Clock.BOOT)

    def _align_gimbal(self, message: GimbalAttitude) -> Message | None:
        """A gimbal's stamp on the boot clock. It counts from its own start: its clock's offset is that of its
        fastest messages."""
        offset, key = self.offset_ns, (message.component, message.device)
        if offset is None or (key not in self._gimbals and len(self._gimbals) >= MOST_GIMBALS):
            self.rejected["no_time_base"] += 1
            return None
        own = message.t_recv_ns - message.t_ns
        fastest = self._gimbals.setdefault(key, [])
        if fastest and abs(own - fastest[0][1]) > JUMP_NS:  # it has started anew
            fastest.clear()
        _lower(fastest, own, message.t_recv_ns)
        return msgspec.structs.replace(message, t_ns=message.t_ns + fastest[0][1] - offset)

    def compare(self, t_recv_ns: int, wall_step_ns: int | None) -> None:
        """Learn how far the wall clock has been set, if arrivals are stamped by a clock that is never set."""
        if wall_step_ns is None:
            return
        self._is_even = True
        if self._wall_steps and self._wall_steps[-1][1] == wall_step_ns:
            return
        if self._wall_steps:
            self.rejected["host_clock_steps"] += 1
        self._wall_steps = [*self._wall_steps[-1:], (t_recv_ns, wall_step_ns)]

    def _unset(self, message: Message) -> int:
        """A stamp of the wall clock on the clock of arrivals. Soon after a step a message may still have been
        stamped before it: of the two times, that one holds whose latency is most like the last one's."""
        t_recv_ns, times = message.t_recv_ns, [message.t_ns]
        if self._wall_steps:
            is_recent = t_recv_ns - self._wall_steps[-1][0] < STEP_SEEN_NS
            times = [message.t_ns - step for _, step in self._wall_steps[-2 if is_recent else -1 :]]
        usual_ns = self._latency_ns.get(type(message))
        t_ns = times[-1] if usual_ns is None else min(times, key=lambda t: abs(t_recv_ns - t - usual_ns))
        self._latency_ns[type(message)] = t_recv_ns - t_ns
        return t_ns

    def receive_reply(self, message: TimeSync) -> None:
        """Learn the offset from a TIMESYNC reply. Autopilots also forward replies to the requests of others; ours
        have our tag in ts1. Where a log holds none of ours, any reply that could be the recorder's is used. One in
        a thousand of those has our tag by chance, so only several tagged replies count as ours."""
        if message.tc1_ns == 0:
            return  # a request
        round_trip = message.t_recv_ns - message.ts1_ns
        ours = message.is_tagged
        if not 0 <= round_trip <= LONGEST_ROUND_TRIP_NS:
            self.rejected["timesync_not_ours"] += 1
            return
        if ours:
            self._tagged = [*self._tagged, message.t_recv_ns][-CONFIRM_TAGGED:]
        asks = len(self._tagged) == CONFIRM_TAGGED and message.t_recv_ns - self._tagged[0] < WINDOW_NS
        if asks and not ours:
            self.rejected["timesync_not_ours"] += 1
            return
        if asks and not self._own_replies:
            self._synced = [s for s in self._synced if s[1] in self._tagged]
        self._own_replies = asks
        offset = (message.ts1_ns + message.t_recv_ns) // 2 - message.tc1_ns
        if self._newest_stamp is not None:
            offset += round((self._base - offset) / BOOT_WRAP_NS) * BOOT_WRAP_NS
        self._synced = [s for s in self._synced if message.t_recv_ns - s[1] < WINDOW_NS]
        self._synced.append((round_trip, message.t_recv_ns, offset))
        self.source = "timesync"
        self.round_trip_ns = min(self._synced)[0]

    def _continues(self, stamp: int, t_recv: int) -> bool:
        """Whether a boot stamp fits. Also updates the offset, and notices a reboot."""
        offset = t_recv - stamp
        if self._newest_stamp is None:
            self._restart(stamp, offset, t_recv)
            return True
        fits = abs(offset - self._base) < JUMP_NS
        runs_on = -JUMP_NS < stamp - self._newest_stamp < CONTINUES_NS
        is_early = bool(self._fastest) and offset < self._fastest[0][1] - AHEAD_NS
        # ahead of its arrival: a wrong stamp, or all messages before had been held up
        ahead = is_early and t_recv >= self._last_arrival
        if (ahead or not (fits or runs_on)) and not self._confirmed(offset):
            return False
        if not fits and not runs_on:
            self.reboots += 1
            self._restart(stamp, offset, t_recv)
            return True
        self._notice_step(offset, t_recv)
        self._odd.clear()
        self._base = offset
        self._newest_stamp = max(self._newest_stamp, stamp)
        self._last_arrival = t_recv
        while self._synced and t_recv - self._synced[0][1] >= WINDOW_NS:
            self._synced.pop(0)
        _lower(self._fastest, offset, t_recv)
        if not self._synced:
            self.source = "arrival"
        return True

    def _notice_step(self, offset: int, t_recv: int) -> None:
        """Whether this computer's clock was set: messages are early, or they stay late."""
        above = offset - self._fastest[0][1] if self._fastest else 0
        if above < JUMP_NS:
            self._late_since = None
        elif self._late_since is None or t_recv < self._late_since:
            self._late_since = t_recv
        stays = self._late_since is not None and t_recv - self._late_since > STEP_LASTS_NS
        if not self._is_even and (above < -JUMP_NS or stays):
            self._fastest.clear()
            self._synced.clear()
            self._late_since = None
            self.rejected["host_clock_steps"] += 1

    def _unwrapped(self, stamp: int, t_recv: int) -> int:
        """A boot stamp on the time base, which goes on when stamps of 32 bits begin anew. Where the time base
        itself began with such stamps, those of 64 bits are larger. What does not fit is returned as it is."""
        if self._newest_stamp is None:
            return stamp
        expected = t_recv - self._base
        wraps = round((expected - stamp) / BOOT_WRAP_NS)
        moved = stamp + wraps * BOOT_WRAP_NS
        runs_on = abs(moved - self._newest_stamp) < CONTINUES_NS
        return moved if wraps and (runs_on or abs(moved - expected) < CONTINUES_NS) else stamp

    def _confirmed(self, offset: int) -> bool:
        """Whether enough other stamps that do not fit either agree with this one."""
        self._odd = [o for o in self._odd if abs(o - offset) < JUMP_NS]
        self._odd.append(offset)
        if len(self._odd) < CONFIRM:
            self.rejected["odd_stamp"] += 1
            return False
        return True

    def _restart(self, stamp: int, offset: int, t_recv: int) -> None:
        self._newest_stamp = stamp
        self._last_arrival = t_recv
        self._base = offset
        self._odd.clear()
        self._synced.clear()
        self._fastest = [(t_recv, offset)]
        self._late_since = self._used = None
        self.round_trip_ns = None
        self.source = "arrival"


def _lower(fastest: list[tuple[int, int]], offset: int, t_recv: int) -> None:
    """Add a message to the lower envelope: by arrival, and each slower than all before it. What was fastest is
    carried on, as far as the clocks may have drifted apart meanwhile."""
    while fastest and fastest[-1][1] >= offset:
        fastest.pop()
    if fastest and t_recv - fastest[0][0] >= WINDOW_NS:
        carried = fastest[0][1] + round(DRIFT * (t_recv - fastest[0][0]))
        while fastest and t_recv - fastest[0][0] >= WINDOW_NS:
            fastest.pop(0)
        if carried < (fastest[0][1] if fastest else offset):
            fastest.insert(0, (t_recv, carried))
    fastest.append((t_recv, offset))

"""One time base: the autopilot's boot clock, in nanoseconds.

`t_ns` of each aligned message is the time at which it was true on that clock: its stamp minus the known delay of
its source (in field data, LOCAL_POSITION_NED was 20 to 25 ms older than its stamp). Stamps of this computer's
clock (camera, Unix time) are converted by the offset between the two clocks (`offset`).

A stamp that does not fit is compared with its neighbours. If only the arrival time has jumped, our own clock was
set or the link was held up. If the boot clock has jumped and the next few messages agree, the autopilot has
rebooted. A single odd stamp is rejected, and one too far ahead of its arrival.
Stamps of the recent past are a jump only if no others arrive between them for a while, since a second link may
repeat messages late and in bulk. Only the autopilot's own stamps are judged: a camera's may lag.
"""

from collections import Counter, deque
from enum import Enum
from typing import Final, NamedTuple

import msgspec

from onboard.clocks.cameras import STAMP_JITTER_TOLERANCE_NS, Followers
from onboard.clocks.odd_stamps import OddStamps
from onboard.clocks.offset import WINDOW_NS, Offset, Reply
from onboard.clocks.wall_clock import WallClock
from onboard.messages import (
    ActuatorOutputs,
    Clock,
    Exposure,
    GimbalAttitude,
    GlobalPosition,
    Message,
    PeerRanges,
    RadarScan,
    SystemTime,
    TimeSync,
)
from onboard.messages.causes import Cause, Reason
from onboard.messages.stamps import Span, read_stamps
from onboard.units import NS_PER_S, S_PER_NS

# Stamped by a sensor, perhaps with the boot clock; usable once our own pose at that time is known.
SENSED: Final = (Exposure, RadarScan, PeerRanges)
SERVO_WRAP_PERIOD_NS: Final = 2**32 * 1000  # SERVO_OUTPUT_RAW stamps in 32 bits of microseconds: 71.6 minutes
BOOT_WRAP_PERIOD_NS: Final = 2**32 * 1_000_000  # time_boot_ms: 49.7 days
JUMP_THRESHOLD_NS: Final = NS_PER_S
MAX_STAMP_STEP_NS: Final = 5 * NS_PER_S
MIN_TAGGED_REPLY_COUNT: Final = 3
STAMP_LEAD_TOLERANCE_NS: Final = 250_000_000  # before its arrival; streams of one real autopilot differ by 140 ms.
MAX_LINK_DELAY_NS: Final = 3 * NS_PER_S  # A longer delay means that a clock was set.
MIN_CORRECTION_SIZE_NS: Final = 50_000_000  # A smaller error of conversion does not affect estimates.
MAX_GIMBAL_COUNT: Final = 8
MAX_ROUND_TRIP_TIME_NS: Final = 200_000_000
MIN_BACKWARD_STEP_NS: Final = 150_000_000  # behind the newest stamp; streams of one clock are closer together.
RATE_REASON: Final = Reason(Cause.CLOCK_RATE, "the rate of the autopilot's clock is uncertain")
TIMESYNC_REASON: Final = Reason(
    Cause.DEGENERATE, "TIMESYNC: its clock is not that of the autopilot's stamps; the arrivals of these are used"
)
MIN_UNIX_TIME_NS: Final = 1_420_070_400 * NS_PER_S  # 2015; an autopilot that does not know the time sends less.
PACE_WINDOW_NS: Final = 100 * NS_PER_S
MAX_PACE_DRIFT_NS: Final = PACE_WINDOW_NS // 50  # The lateness of a slow radio changes by up to 2 %.


class ClockEvent(Enum):
    """Changes of the time base, after which estimates may have to restart."""

    REBOOTED = "rebooted"
    CLOCK_SET = "clock_set"  # back by some seconds: no reboot
    CORRECTED = "corrected"  # stamps of this computer had been converted wrongly


class Aligned(NamedTuple):
    """A message on the boot clock, minus its delay."""

    message: Message | None
    offset_ns: int | None  # host clock minus boot clock at its arrival, None before the first message
    event: ClockEvent | None = None
    why: str | Reason = ""  # without a message: the counter or the reason of its rejection


class Clocks:
    """The offset of the host clock from the boot clock, ns, and the latter's continuity."""

    def __init__(self) -> None:
        self.is_one_clock = True  # One clock stamps all arrivals; another program's log may combine several.
        self.reboots = 0
        self.jumps = 0  # of the autopilot's clock, back by some seconds: no reboot
        self._event: ClockEvent | None = None  # by the message that is aligned
        self._why: str | Reason = ""
        self.rejected: Counter[str] = Counter()  # unusable messages and replies, by reason
        self.restart()

    def restart(self) -> None:
        """Forget the time base, but not the counts, since another autopilot is followed."""
        self._wall = WallClock()
        self._offset = Offset()
        self._followers = Followers()
        self._unix: deque[tuple[int, int]] = deque()  # arrivals of SYSTEM_TIME, and its lateness by Unix time
        self.source = "none"
        self._newest_stamp: int | None = None
        self._last_arrival = 0
        self._base = 0  # host - boot at the last message: coarse, for continuity only
        self._odd = OddStamps()
        self._before = 0  # host - boot at the last message that fits
        self._tagged: list[int] = []  # arrivals of the last replies with our tag
        self._own_replies = False
        self._gimbals: dict[tuple[int, int], Offset] = {}  # of each gimbal's own clock
        self._late_since: int | None = None  # arrival since which messages are late by a second or more
        self._used: tuple[int, int] | None = None  # arrival and offset of the last stamp that was converted

    @property
    def offset_ns(self) -> int | None:
        """Host clock minus boot clock at the last message's arrival, None before the first."""
        return self._offset.at(self._last_arrival)

    @property
    def round_trip_ns(self) -> int | None:
        """The shortest round trip of the last TIMESYNC replies, None without replies."""
        return self._offset.round_trip_ns

    @property
    def rate(self) -> float:
        """Seconds of the boot clock per second of this computer's: 1, except for a simulator."""
        return 1.0 - self._offset.slope

    @property
    def doubt(self) -> Reason | None:
        """Reason why stamps of this computer cannot be converted well at present, or None."""
        return RATE_REASON if self._offset.doubt and self._used is not None else None

    def age_ns(self, t_ns: int, at_ns: int) -> int:
        """Return the age at `at_ns` (this computer's clock) of a state at `t_ns` (boot clock).

        It is 0 if arrivals are stamped by a clock that may have been set."""
        offset = self._offset.at(at_ns)
        return at_ns - offset - t_ns if self._wall.is_even and offset is not None else 0

    def align(self, message: Message, delay_ns: int = 0) -> Aligned:
        """Convert a message to the boot clock; a message of unknown time is rejected."""
        self._event, self._why = None, ""
        found = self._convert(message, delay_ns)
        if isinstance(found, SystemTime) and found.unix_ns > MIN_UNIX_TIME_NS:
            self._compare_rates(found.t_recv_ns, found.t_recv_ns - found.unix_ns)
        return Aligned(found, self.offset_ns, None if found is None else self._event, self._why)

    def _convert(self, message: Message, delay_ns: int) -> Message | None:
        t_ns = message.t_ns
        if isinstance(message, GimbalAttitude):
            return self._align_gimbal(message)
        if message.clock is Clock.BOOT:
            if isinstance(message, SENSED):
                if self._newest_stamp is None:
                    return self._refuse("no_time_base")
                offset, latest = self._offset.bounds(message.t_recv_ns)
                stamp = self._followers.stamp(message, self._unwrapped(t_ns, message.t_recv_ns), offset or 0)
                return self._at_exposure(message, stamp - delay_ns, latest if self.is_one_clock else None)
            if isinstance(message, ActuatorOutputs) and self._newest_stamp is not None:
                t_ns += round((self._newest_stamp - t_ns) / SERVO_WRAP_PERIOD_NS) * SERVO_WRAP_PERIOD_NS
            if isinstance(message, GlobalPosition):
                if self._newest_stamp is None:
                    return self._refuse("no_time_base")
                t_ns = self._correct_unit(t_ns, message.t_recv_ns)
            t_ns = self._unwrapped(t_ns, message.t_recv_ns)
            if not self._continues(t_ns, message):
                return self._refuse("odd_stamp")
        else:
            if self._offset.at(message.t_recv_ns) is None:
                return self._refuse("no_time_base")
            host_ns = self._wall.unset(message)
            offset = self._offset_at(host_ns)
            self._detect_correction(message.t_recv_ns, offset)
            t_ns = host_ns - offset
            if isinstance(message, SENSED):
                return self._at_exposure(message, t_ns - delay_ns, offset)
        t_ns -= delay_ns
        if t_ns == message.t_ns and message.clock is Clock.BOOT:
            return message
        return message.at(t_ns)

    def _compare_rates(self, t_recv_ns: int, late_ns: int) -> None:
        """Compare the rate of the autopilot's Unix time with this computer's.

        If they agree, its boot clock runs alike, and arrivals that come ever later or earlier only show a slow
        link. They do not agree in a simulator that runs faster or slower than real time."""
        self._unix.append((t_recv_ns, late_ns))
        while not 0 <= t_recv_ns - self._unix[0][0] <= PACE_WINDOW_NS:
            self._unix.popleft()
        self._offset.is_paced = abs(late_ns - self._unix[0][1]) < MAX_PACE_DRIFT_NS

    def _offset_at(self, t_ns: int) -> int:
        return self._offset.at(t_ns) or 0

    def _refuse(self, counted: str, why: Reason | None = None) -> Message | None:
        self._why = why or counted
        self.rejected[counted] += 1
        return None

    def _at_exposure(self, message: Message, t_ns: int, offset: int | None) -> Message | None:
        """Return a sensor's message at its time, or None if it arrived before that time.

        Then its clock is wrong, or `clock` names another. `offset` is None where too little is known."""
        if offset is None:
            return message.at(t_ns)
        later = t_ns + offset - message.t_recv_ns
        if later > STAMP_JITTER_TOLERANCE_NS:
            late = Reason(
                Cause.LATER_THAN_ARRIVAL,
                f"later_than_arrival: `t_ns` is {later * S_PER_NS:.3f} s later than the message arrived; expected "
                f"the time of exposure on the clock `{message.clock.value}`, or a `delay` of as much",
            )
            arrived, boot = message.t_recv_ns, message.t_recv_ns - offset
            spans = {Clock.HOST: Span(arrived, arrived), Clock.BOOT: Span(boot, boot)}
            reading = read_stamps([message.t_ns], message.clock, spans)
            if reading is not None:
                words = late.also(f"it looks like {reading.words}: {reading.remedy}").words
                return self._refuse("later_than_arrival", Reason(Cause.OTHER_CLOCK, words))
            return self._refuse("later_than_arrival", late)
        return message.at(t_ns)

    def _detect_correction(self, t_recv: int, offset: int) -> None:
        """Set the event if stamps of this computer were converted with a wrong offset."""
        if self._used is not None:
            expected = self._used[1] + round(self._offset.slope * (t_recv - self._used[0]))
            is_wrong = abs(offset - expected) > MIN_CORRECTION_SIZE_NS
            if is_wrong and (self._wall.is_even or self._offset.slope != 0.0):
                self._event = ClockEvent.CORRECTED
        self._used = t_recv, offset

    def _align_gimbal(self, message: GimbalAttitude) -> Message | None:
        """Convert a gimbal's stamp to the boot clock.

        Its clock counts from its own start; its offset is that of its fastest messages."""
        offset, key = self._offset.at(message.t_recv_ns), (message.component, message.device)
        if offset is None or (key not in self._gimbals and len(self._gimbals) >= MAX_GIMBAL_COUNT):
            return self._refuse("no_time_base")
        own = message.t_recv_ns - message.t_ns
        known = self._gimbals.setdefault(key, Offset())
        if abs(own - (known.at(message.t_recv_ns) or own)) > JUMP_THRESHOLD_NS:  # it has restarted
            known.clear()
        known.add_arrival(message.t_recv_ns, own)
        return msgspec.structs.replace(message, t_ns=message.t_ns + (known.at(message.t_recv_ns) or own) - offset)

    def resume(self, round_trip_ns: int, t_recv_ns: int, offset_ns: int) -> None:
        """Continue with the offset of an earlier run, which a round trip measured at `t_recv_ns`."""
        self._offset.add_reply(Reply(round_trip_ns, t_recv_ns, offset_ns))
        self.source = "timesync"

    def compare(self, t_recv_ns: int, wall_step_ns: int | None) -> None:
        """Store the step of the wall clock, if arrivals are stamped by a clock that is never set."""
        if self._wall.compare(t_recv_ns, wall_step_ns):
            self.rejected["host_clock_steps"] += 1

    def receive_reply(self, message: TimeSync) -> Reason | None:
        """Update the offset with a TIMESYNC reply; return the reason if it is of another clock.

        Autopilots also forward replies to requests of others; ours have our tag in ts1. If a log contains none of
        ours, any reply that could be the recorder's is used. One in a thousand of these has our tag by chance, so
        only several tagged replies count as ours.
        """
        if message.tc1_ns == 0:
            return None  # a request
        round_trip = message.t_recv_ns - message.ts1_ns
        ours = message.is_tagged
        if not 0 <= round_trip <= MAX_ROUND_TRIP_TIME_NS:
            self.rejected["timesync_not_ours"] += 1
            return None
        if ours:
            self._tagged = [*self._tagged, message.t_recv_ns][-MIN_TAGGED_REPLY_COUNT:]
        asks = len(self._tagged) == MIN_TAGGED_REPLY_COUNT and message.t_recv_ns - self._tagged[0] < WINDOW_NS
        if asks and not ours:
            self.rejected["timesync_not_ours"] += 1
            return None
        if asks and not self._own_replies:
            self._offset.keep(self._tagged)
        self._own_replies = asks
        offset = (message.ts1_ns + message.t_recv_ns) // 2 - message.tc1_ns
        if self._newest_stamp is not None:
            offset += round((self._base - offset) / BOOT_WRAP_PERIOD_NS) * BOOT_WRAP_PERIOD_NS
            shown = self._base, self._offset.carried(message.t_recv_ns)
            if all(abs(offset - by_stamps) > JUMP_THRESHOLD_NS for by_stamps in shown):
                self.rejected["timesync_contradicted"] += 1
                return None if self._odd.is_pending else TIMESYNC_REASON
        self._offset.add_reply(Reply(round_trip, message.t_recv_ns, offset))
        self.source = "timesync"
        return None

    def _continues(self, stamp: int, message: Message) -> bool:
        """Whether a boot stamp fits. Updates the offset and detects reboots and jumps back."""
        t_recv = message.t_recv_ns
        offset = t_recv - stamp
        if self._newest_stamp is None:
            self._restart(stamp, offset, t_recv)
            return True
        fits = abs(offset - self._base) < JUMP_THRESHOLD_NS
        runs_on = -JUMP_THRESHOLD_NS < stamp - self._newest_stamp < MAX_STAMP_STEP_NS
        above = offset - self._offset.carried(t_recv) if self._offset.fastest else 0
        is_early = above < -STAMP_LEAD_TOLERANCE_NS
        # ahead of its arrival: a wrong stamp, or all earlier messages were held up
        ahead = is_early and t_recv >= self._last_arrival
        is_repeated = self._odd.repeats(message)
        if (ahead or not (fits or runs_on)) and not self._odd.confirm(t_recv, stamp, self._base, is_repeated):
            return False
        if not fits and not runs_on:
            self._restart_after_jump(stamp, offset, t_recv)
            return True
        if stamp < self._newest_stamp - MIN_BACKWARD_STEP_NS and not ahead:
            if not is_repeated and self._odd.stays_back(t_recv):
                self._restart_after_jump(stamp, offset, t_recv)
            return True
        if ahead:
            self._followers.jump(self._before)
        self._detect_step(above, t_recv)
        self._base = offset
        self._newest_stamp = max(self._newest_stamp, stamp)
        self._last_arrival = t_recv
        self._odd.fit(self._newest_stamp)
        self._offset.add_arrival(t_recv, offset)
        self._before = self._offset_at(t_recv)
        if not self._offset.replies:
            self.source = "arrival"
        return True

    def _restart_after_jump(self, stamp: int, offset: int, t_recv: int) -> None:
        """Restart the time base: the autopilot has rebooted or set its clock."""
        if self._odd.may_repeat(stamp, offset - self._base):
            self.jumps, self._event = self.jumps + 1, ClockEvent.CLOCK_SET
            self.rejected["autopilot_clock_jumps"] += 1
        else:
            self.reboots += 1
            self._event = ClockEvent.REBOOTED
        self._followers.jump(self._before)
        self._restart(stamp, offset, t_recv)

    def _detect_step(self, above: int, t_recv: int) -> None:
        """Clear the offset if this computer's clock was set: messages are early, or stay late.

        `above` is this message's offset minus that of the fastest."""
        if above < JUMP_THRESHOLD_NS:
            self._late_since = None
        elif self._late_since is None or t_recv < self._late_since:
            self._late_since = t_recv
        stays = self._late_since is not None and t_recv - self._late_since > MAX_LINK_DELAY_NS
        if not self._wall.is_even and (above < -JUMP_THRESHOLD_NS or stays):
            self._offset.clear()
            self._late_since = None
            self.rejected["host_clock_steps"] += 1

    def _correct_unit(self, stamp: int, t_recv: int) -> int:
        """Return the stamp of a GLOBAL_POSITION_INT.

        INAV and Betaflight write microseconds into its field of milliseconds. It is read as microseconds if it
        fits only as these. Therefore none of these messages starts a time base."""
        expected = t_recv - self._base
        read = stamp // 1000
        read += round((expected - read) / SERVO_WRAP_PERIOD_NS) * SERVO_WRAP_PERIOD_NS
        if abs(stamp - expected) < JUMP_THRESHOLD_NS or abs(read - expected) > STAMP_LEAD_TOLERANCE_NS:
            return stamp
        self.rejected["microseconds_for_milliseconds"] += 1  # and used
        return read

    def _unwrapped(self, stamp: int, t_recv: int) -> int:
        """Return a boot stamp on the time base, which continues when 32-bit stamps wrap.

        If the time base began with such stamps, 64-bit stamps are larger. A stamp that does not fit is returned
        unchanged."""
        if self._newest_stamp is None:
            return stamp
        expected = t_recv - self._base
        if 2 * abs(expected - stamp) < BOOT_WRAP_PERIOD_NS:  # as nearly always
            return stamp
        wraps = round((expected - stamp) / BOOT_WRAP_PERIOD_NS)
        moved = stamp + wraps * BOOT_WRAP_PERIOD_NS
        runs_on = abs(moved - self._newest_stamp) < MAX_STAMP_STEP_NS
        return moved if wraps and (runs_on or abs(moved - expected) < MAX_STAMP_STEP_NS) else stamp

    def _restart(self, stamp: int, offset: int, t_recv: int) -> None:
        self._newest_stamp, self._last_arrival, self._base = stamp, t_recv, offset
        self._odd.fit(stamp)
        self._offset.clear()
        self._offset.fastest.append((t_recv, offset))
        self._before = offset
        self._late_since = self._used = None
        self.source = "arrival"

"""Sensor data over Zenoh, one JSON document per sample.

- `<prefix>/camera/<camera>/points` or `detections`: `CameraPoints` or `CameraDetections` per image (from
  `onboard ros2` as CDR on `<prefix>/camera/<camera>/ros/<package>/<type>`)
- `<prefix>/radar/<radar>/detections`: `RadarDetections` per scan
- `<prefix>/gnss/<peer>/pseudoranges`: `Pseudoranges` per epoch of another vehicle's receiver

Keys are unlimited, so samples that wait for the event loop have room by their source: our own camera's, other
cameras', radars', receivers'. A flood of one never drops a sample of another.

Only a sample's key states its vehicle. Of two sessions that claim one vehicle, as after copying a card, the one
whose vehicle is armed, or that has run for longer, keeps the name. The other one ends, unless its own vehicle is
armed: then it uses no sample, which may show what the other vehicle sees.
"""

import asyncio
import math
import threading
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import partial
from typing import Any, Final

from onboard.links.link import Backlog, Deliver, Link, LinkError, NowNs, guarded
from onboard.messages import Datagram, Encoding, LinkHealth
from onboard.messages.causes import Cause, Reason

MAX_DOCUMENT_BYTES: Final = 65_536  # as in `onboard.wire.documents.document`
WATCH_PERIOD_S: Final = 2.0  # of the check who is connected
ARMED_TIMEOUT_S: Final = 5.0  # for a first heartbeat, before our vehicle is taken for disarmed
MAX_WAITING_COUNT: Final = 256  # of one source; in a flood the newest are dropped


class ZenohLink(Link):
    """Subscriber to the sensors' keys on a session of `onboard.sinks.zenoh_session`.

    It does not close the session. The channel of a datagram is its key. `camera` is the name of our own camera;
    `ros` are the keys of detections in ROS. Samples that have waited for `longest_wait_s` are left out.
    """

    def __init__(
        self,
        session: Any,
        prefix: str,
        *,
        camera: str,
        channel: str = "zenoh",
        ros: Iterable[str] = (),
        longest_wait_s: float = math.inf,
        is_armed: Callable[[], bool | None] = lambda: False,
    ) -> None:
        self.channel = channel
        self._backlog = Backlog(longest_wait_s)
        self._session = session
        self._keys = {
            f"{prefix}/camera/*/points": Encoding.POINTS,
            f"{prefix}/camera/*/detections": Encoding.DETECTIONS,
            f"{prefix}/camera/*/ros/*/*": Encoding.ROS,  # of `onboard ros2`
            f"{prefix}/radar/*/detections": Encoding.RADAR,
            f"{prefix}/gnss/*/pseudoranges": Encoding.RANGES,
            **dict.fromkeys(ros, Encoding.ROS),
        }
        self._camera = f"{prefix}/camera/{camera}/"
        self._prefix = prefix
        self._is_armed = is_armed
        self._rivals = ""  # sessions that claim the same name, for people
        self._yields = False  # whether one of them keeps it

    async def open(self) -> None:
        """Raises LinkError if the session is closed. `run` subscribes."""
        if self._session.is_closed():
            raise LinkError(f"{next(iter(self._keys))}: the Zenoh session is closed")

    async def run(self, deliver: Deliver, now_ns: NowNs) -> None:
        """Call `deliver` with each sample until cancelled."""
        loop = asyncio.get_running_loop()
        failed: asyncio.Future[None] = loop.create_future()
        safe = guarded(deliver, failed)

        ours = threading.Semaphore(MAX_WAITING_COUNT)
        rooms = {encoding: threading.Semaphore(MAX_WAITING_COUNT) for encoding in self._keys.values()}

        def enter(datagram: Datagram, room: threading.Semaphore) -> None:
            room.release()
            if not self._backlog.skips(now_ns() - datagram.t_recv_ns):
                self.received += 1
                safe(datagram)

        def on_sample(sample: Any, encoding: Encoding) -> None:  # on one of Zenoh's threads
            t_recv_ns = now_ns()
            if self._yields:
                self.errors += 1
                return
            room = ours if str(sample.key_expr).startswith(self._camera) else rooms[encoding]
            if not room.acquire(blocking=False):
                self.errors += 1
                return
            with suppress(RuntimeError):  # the loop has closed: so will this link
                loop.call_soon_threadsafe(enter, _datagram(sample, t_recv_ns, encoding), room)

        def fail(error: LinkError) -> None:
            if not failed.done():
                failed.set_exception(error)

        def end(error: LinkError) -> None:  # on the thread that watches
            with suppress(RuntimeError):  # as above
                loop.call_soon_threadsafe(fail, error)

        ended = threading.Event()
        # A thread of its own, which nobody waits for at the end: a name server may be silent for a minute.
        threading.Thread(target=self._watch, args=(ended, end), name="zenoh-watch", daemon=True).start()
        subscribers: list[Any] = []
        try:
            declare = self._session.declare_standing
            subscribers.append(await asyncio.to_thread(declare, self._prefix, self._is_armed))
            for key, encoding in self._keys.items():
                callback = partial(on_sample, encoding=encoding)
                subscribers.append(await asyncio.to_thread(self._session.declare_subscriber, key, callback))
            await failed
        finally:
            ended.set()
            for subscriber in subscribers:
                subscriber.undeclare()

    def _watch(self, ended: threading.Event, end: Callable[[LinkError], None]) -> None:
        """Look who is connected, and who claims our name, until `ended`."""
        while True:
            try:
                self.trouble = self._session.trouble()
                self._judge_rivals(end)
            except Exception as error:  # of any kind: the session may be closing; it must not end the flight
                self.trouble = Reason(Cause.FAILED, f"cannot tell who is connected ({error})")
            if ended.wait(WATCH_PERIOD_S):
                return

    def health(self) -> LinkHealth:
        """The link's counts, connected routers and unreachable ones."""
        is_closed = self._session.is_closed()
        routers = 0 if is_closed else len(self._session.info.routers_zid())
        trouble = self.trouble if is_closed or not self._rivals else Reason(Cause.NAME_SHARED, self._rivals)
        return LinkHealth(
            received=self.received,
            sent=self.sent,
            errors=self.errors,
            skipped=self._backlog.skipped,
            routers=routers,
            cause=trouble.cause,
            error=trouble.words,
        )

    def _judge_rivals(self, end: Callable[[LinkError], None]) -> None:
        """Decide which session keeps the name, once it is known whether our vehicle is armed."""
        is_armed, age_s = self._is_armed(), self._session.age_s()
        rivals = self._session.find_rivals(self._prefix)
        if is_armed is None and age_s < ARMED_TIMEOUT_S:
            return
        self._yields = any((r.is_armed, r.age_s) > (bool(is_armed), age_s) for r in rivals.values())
        names = ", ".join(sorted(f"{r.computer}, session {session}" for session, r in rivals.items()))
        what = f"vehicle `{self._prefix.rpartition('/')[2]}` is also the name of {names}" if rivals else ""
        if self._yields and not is_armed:
            end(LinkError(f"zenoh: {what}; give this one its own: `onboard init --vehicle NAME`"))
        self._rivals = what + ("; no sample is used" if self._yields else "")

    def send(self, data: bytes) -> None:  # noqa: ARG002 - the protocol's signature
        """This link cannot send; counts an error."""
        self.errors += 1


def _datagram(sample: Any, t_recv_ns: int, encoding: Encoding) -> Datagram:
    """Convert a sample; one that is too large is truncated, so the decoder refuses it."""
    data = sample.payload.to_bytes()[: MAX_DOCUMENT_BYTES + 1]
    return Datagram(channel=str(sample.key_expr), encoding=encoding, t_recv_ns=t_recv_ns, data=data)

"""A client of a running daemon, for the view and the demo.

It subscribes to the records of the daemon and of a simulator. They arrive on Zenoh's threads and are queued.
"""

import queue
import threading
from typing import Any, Final, NamedTuple

import msgspec
from msgspec.structs import replace

from onboard.messages import Estimate, Health, NavState, OwnPose, Picture, Record, SimStatus, Truth
from onboard.messages.text import plain, plain_record
from onboard.sinks.zenoh_session import ZenohConfig, wait_for_session

RECORD_TYPES: Final[dict[str, type[Record]]] = {
    "estimate": Estimate,
    "own_state": NavState,
    "ownship": OwnPose,
    "health": Health,
    "truth": Truth,
    "status": SimStatus,
    "picture": Picture,
}


class PublishedRecord(NamedTuple):
    """A record with the time of its publication and the vehicle in its key."""

    record: Any
    t_publish_ns: int | None  # this computer's clock; None if the publisher sent none
    vehicle: str = ""


class Client:
    """A subscription to one vehicle's daemon, or to all with None, and to the simulator's truth.

    `credentials` authenticate us to a router; their mode and endpoints are not used. `alive` is set while the
    vehicle runs (of several, the one that changed last). Raises SinkError if no daemon answers at `endpoint`
    within `wait_s` seconds.
    """

    def __init__(
        self, endpoint: str, vehicle: str | None, credentials: ZenohConfig | None = None, wait_s: float = 0.0
    ) -> None:
        config = replace(credentials or ZenohConfig(), mode="client", listen=(), connect=(endpoint,))
        if vehicle is not None:
            config = replace(config, vehicle=vehicle, user=config.user or config.vehicle)
        of = vehicle or "*"
        self.alive = threading.Event()
        self.unread = 0  # records that could not be decoded
        self._records: queue.SimpleQueue[PublishedRecord] = queue.SimpleQueue()
        self._decoders = {name: msgspec.json.Decoder(kind) for name, kind in RECORD_TYPES.items()}
        self._session = wait_for_session(config, wait_s)
        keys = (
            *(f"onboard/{of}/{name}" for name in ("estimate/**", "own_state", "ownship", "health")),
            *(f"simlink/{of}/{name}" for name in ("truth", "status", "picture")),
        )
        self._subscribers = [self._session.declare_subscriber(key, self._receive) for key in keys]
        self._subscribers.append(self._session.watch_liveliness(f"onboard/{of}/alive", self._update_alive))

    def take(self, timeout: float) -> PublishedRecord | None:
        """Return the next record, or None after `timeout` seconds without one."""
        try:
            return self._records.get(timeout=timeout)
        except queue.Empty:
            return None

    def put(self, key: str, data: bytes) -> None:
        """Send bytes to the daemon; may be called from any thread."""
        self._session.put(key, data)

    def close(self) -> None:
        """End the subscription. Queued records remain available."""
        self._session.close()

    def _receive(self, sample: Any) -> None:
        """Queue a record; called on one of Zenoh's threads."""
        parts = str(sample.key_expr).split("/")
        name = "estimate" if "estimate" in parts else parts[-1]
        attachment = sample.attachment
        try:
            record: Record = self._decoders[name].decode(sample.payload.to_bytes())
            if isinstance(record, Health | Estimate):  # any program may have published it
                record = plain_record(record)
            t_publish_ns = int(attachment.to_bytes()) if attachment is not None else None
        except (msgspec.DecodeError, ValueError):
            self.unread += 1
            return
        self._records.put(PublishedRecord(record, t_publish_ns, plain(parts[1])))

    def _update_alive(self, sample: Any) -> None:
        import zenoh  # noqa: PLC0415 - loaded already: there is a session

        if sample.kind == zenoh.SampleKind.PUT:
            self.alive.set()
        else:
            self.alive.clear()

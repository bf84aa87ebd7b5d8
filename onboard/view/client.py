"""A client of a running daemon, for the view and the demo: subscribes to what it and a simulator publish.

Records arrive on Zenoh's threads and wait in a queue until they are taken.
"""

import queue
import threading
from typing import Any, Final, NamedTuple

import msgspec

from onboard.messages import Estimate, Health, NavState, OwnPose, Record, SimStatus, Truth
from onboard.sinks.zenoh_session import ZenohConfig, open_session

KINDS: Final[dict[str, type[Record]]] = {
    "estimate": Estimate,
    "own_state": NavState,
    "ownship": OwnPose,
    "health": Health,
    "truth": Truth,
    "status": SimStatus,
}


class Received(NamedTuple):
    """A record, and the time of its publication (ns, this computer's clock; None if the publisher sent none)."""

    record: Any
    t_publish_ns: int | None


class Client:
    """A subscription to one vehicle's daemon, and to the simulator's truth.

    Raises SinkError when no daemon answers at `endpoint`.
    """

    def __init__(self, endpoint: str, vehicle: str) -> None:
        config = ZenohConfig(vehicle=vehicle, mode="client", listen=(), connect=(endpoint,))
        self.alive = threading.Event()
        self.undecodable = 0
        self._records: queue.SimpleQueue[Received] = queue.SimpleQueue()
        self._decoders = {name: msgspec.json.Decoder(kind) for name, kind in KINDS.items()}
        self._session = open_session(config)
        keys = (
            *(f"{config.prefix}/{name}" for name in ("estimate/**", "own_state", "ownship", "health")),
            *(f"simlink/{vehicle}/{name}" for name in ("truth", "status")),
        )
        self._subscribers = [self._session.declare_subscriber(key, self._receive) for key in keys]
        self._subscribers.append(self._session.watch_liveliness(f"{config.prefix}/alive", self._update_alive))

    def take(self, timeout: float) -> Received | None:
        """The next record, None if none comes within `timeout` seconds."""
        try:
            return self._records.get(timeout=timeout)
        except queue.Empty:
            return None

    def close(self) -> None:
        """End the subscription. Records received before can still be taken."""
        self._session.close()

    def _receive(self, sample: Any) -> None:
        """Queue a record; called on one of Zenoh's threads."""
        parts = str(sample.key_expr).split("/")
        name = "estimate" if "estimate" in parts else parts[-1]
        attachment = sample.attachment
        try:
            record = self._decoders[name].decode(sample.payload.to_bytes())
            t_publish_ns = int(attachment.to_bytes()) if attachment is not None else None
        except (msgspec.DecodeError, ValueError):
            self.undecodable += 1
            return
        self._records.put(Received(record, t_publish_ns))

    def _update_alive(self, sample: Any) -> None:
        import zenoh  # noqa: PLC0415 - loaded already: there is a session

        if sample.kind == zenoh.SampleKind.PUT:
            self.alive.set()
        else:
            self.alive.clear()

"""Zenoh: the one session of the program, and the sink that publishes on it.

Below `onboard/<vehicle>/`: `estimate/<name>`, `own_state`, `ownship` and `health` are published as JSON and
answer queries with the latest value; the attachment of what is published is the time of publication, in ns of
this computer's clock, as decimal ASCII; the liveliness token `alive` is there while the program is. A reply
carries the attachment `{"age_s": ..., "stale": ...}`, and an estimate published longer ago than the validity
timeout comes back as lost and not valid: a late joiner can never take an old value for a fresh one.
"""

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

import msgspec

from onboard.messages import Estimate, Health, Lifecycle, OwnPose, Record
from onboard.schemas import key_of
from onboard.sinks.sink import SinkError

if TYPE_CHECKING:
    import zenoh

Published = Estimate | OwnPose | Health

CAPACITY: Final = 2048  # records waiting; a second or two, or the tracks of a busy sky a few times
FORBIDDEN: Final = "*$?#/"
QUERYABLE: Final = ("estimate/**", "own_state", "ownship", "health")
DEFAULT_LISTEN: Final = ("tcp/127.0.0.1:7447",)


class ZenohConfig(Record, frozen=True, kw_only=True):
    """How to take part in Zenoh. The defaults make us the router on this computer's loopback and nothing else.

    `config_file` is a Zenoh JSON5 file for what is not here (TLS, passwords, access control); what it leaves
    unsaid keeps our defaults, and `mode`, `listen` and `connect` then count only where it does.
    """

    enabled: bool = True
    vehicle: str = "1"
    mode: Literal["router", "peer", "client"] = "router"
    listen: tuple[str, ...] = DEFAULT_LISTEN
    connect: tuple[str, ...] = ()
    max_message_size: int = 262_144  # bytes; Zenoh's own default would let a peer send us 1 GiB
    config_file: str | None = None

    def __post_init__(self) -> None:
        """Raises ValueError for a vehicle that cannot stand in a key."""
        v = self.vehicle
        if not v or not v.isascii() or not v.isprintable() or any(c in FORBIDDEN or c.isspace() for c in v):
            raise ValueError(f"vehicle {v!r} cannot be part of a key: use letters, digits, - and _, as uav-1")

    @property
    def prefix(self) -> str:
        """What all our keys begin with."""
        return f"onboard/{self.vehicle}"


def open_session(config: ZenohConfig) -> "zenoh.Session":
    """Open the session; blocks for some ten milliseconds (client and connect: until the peer answers).

    Raises SinkError: port in use, no router there, unreadable file.
    """
    import zenoh  # noqa: PLC0415 - replay never loads it

    try:
        return zenoh.open(_zenoh_config(config))
    except zenoh.ZError as error:
        raise SinkError(_explanation(config, str(error))) from error


def _explanation(config: ZenohConfig, error: str) -> str:
    """One line for what Zenoh says at length."""
    if "Address already in use" in error:
        return f"zenoh: {', '.join(config.listen)} is in use: is another router, or another onboard, running?"
    if config.mode == "client":
        return f"zenoh: no router answers at {', '.join(config.connect) or 'any address: set connect'}"
    reason = error.splitlines()[0].split(" at /")[0]  # the rest names places in Zenoh's sources
    return f"zenoh: cannot open a session ({reason})"


def _zenoh_config(config: ZenohConfig) -> Any:
    """Zenoh's form of it. Raises SinkError when the file cannot be read."""
    import zenoh  # noqa: PLC0415 - replay never loads it

    untouched = zenoh.Config()
    try:
        result = zenoh.Config.from_file(config.config_file) if config.config_file else zenoh.Config()
    except zenoh.ZError as error:
        problem = "cannot be read as Zenoh JSON5" if Path(str(config.config_file)).exists() else "does not exist"
        raise SinkError(f"zenoh: config_file {config.config_file} {problem}") from error
    ours = {
        "mode": config.mode,
        "listen/endpoints": [] if config.mode == "client" else list(config.listen),
        "connect/endpoints": list(config.connect),
        "scouting/delay": 0,  # opening would wait half a second for the answers to a scouting we do not do
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/link/rx/max_message_size": config.max_message_size,
        # Room for a tenth of a second of estimates, so that a subscriber may be busy for a moment; when it is
        # full, drop at once rather than wait a millisecond (50 for fragments) for a peer that does not read.
        "transport/link/tx/queue/size/data": 16,
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 0,
        "transport/link/tx/queue/congestion_control/drop/max_wait_before_drop_fragments": 0,
        # A killed process would leave segments behind, and our messages are too short to gain by it.
        "transport/shared_memory/enabled": False,
    }
    for key, value in ours.items():
        if result.get_json(key) == untouched.get_json(key):
            result.insert_json5(key, msgspec.json.encode(value).decode())
    return result


class ZenohSink:
    """Sink that publishes on a session opened and closed elsewhere."""

    def __init__(
        self,
        session: "zenoh.Session",
        prefix: str,
        *,
        validity_s: float = 2.0,
        monotonic: Callable[[], float] = time.monotonic,
        now_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._session, self._prefix = session, prefix
        self._now_ns = now_ns
        self._validity_s, self._monotonic = validity_s, monotonic
        self._encoder = msgspec.json.Encoder()
        self._latest: dict[str, tuple[Published, float]] = {}  # key -> record, when it was published
        self._publishers: dict[str, Any] = {}
        self._declared: list[Any] = []

    def open(self) -> None:
        """Declare the queryables and, last, that we are alive. Raises SinkError when the session is closed."""
        if self._session.is_closed():
            raise SinkError("zenoh: the session is closed")
        for pattern in QUERYABLE:
            key = f"{self._prefix}/{pattern}"
            self._declared.append(self._session.declare_queryable(key, self._answer))
        self._declared.append(self._session.liveliness().declare_token(f"{self._prefix}/alive"))

    def write(self, records: Sequence[Published]) -> None:
        """Publish each."""
        for record in records:
            key = f"{self._prefix}/{key_of(record)}"
            publisher = self._publishers.get(key) or self._declare(key)
            self._latest[key] = record, self._monotonic()
            publisher.put(self._encoder.encode(record), attachment=b"%d" % self._now_ns())
            if (
                isinstance(record, Estimate)
                and record.target != record.name
                and record.state is Lifecycle.SEARCHING
            ):
                self._publishers.pop(key).undeclare()  # the last word on one of many, of which there is no end
                del self._latest[key]

    def close(self) -> None:
        """Undeclare everything, the token first."""
        declared = [*self._declared, *self._publishers.values()]
        self._declared, self._publishers = [], {}
        if not self._session.is_closed():
            for thing in reversed(declared):
                thing.undeclare()

    def _declare(self, key: str) -> Any:
        import zenoh  # noqa: PLC0415 - loaded already: there is a session

        drop, json = zenoh.CongestionControl.DROP, zenoh.Encoding.APPLICATION_JSON
        publisher = self._session.declare_publisher(key, encoding=json, congestion_control=drop, express=True)
        self._publishers[key] = publisher
        return publisher

    def _answer(self, query: Any) -> None:
        """Reply with the latest values the query asks for. On one of Zenoh's threads."""
        import zenoh  # noqa: PLC0415 - loaded already: there is a session

        with query:
            for key, (record, t_published) in list(self._latest.items()):
                if query.key_expr.intersects(zenoh.KeyExpr(key)):
                    payload, attachment = aged(record, self._monotonic() - t_published, self._validity_s)
                    json = zenoh.Encoding.APPLICATION_JSON
                    query.reply(key, payload, encoding=json, attachment=attachment)


def aged(record: Published, age_s: float, validity_s: float) -> tuple[bytes, bytes]:
    """(payload, attachment) of a reply with a record published `age_s` seconds ago."""
    stale = age_s > validity_s
    if stale and isinstance(record, Estimate):
        reason = f"stale: published {age_s:.1f} s ago"
        record = msgspec.structs.replace(record, valid=False, state=Lifecycle.LOST, reason=reason)
    attachment = {"age_s": round(age_s, 3), "stale": stale}
    return msgspec.json.encode(record), msgspec.json.encode(attachment)

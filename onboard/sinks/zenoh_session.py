"""The one Zenoh session of a program: how it takes part, and how it ends."""

import queue
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, Literal

import msgspec

from onboard.messages import Record
from onboard.sinks.sink import SinkError

FORBIDDEN: Final = "*$?#/"
DEFAULT_LISTEN: Final = ("tcp/127.0.0.1:7447",)
CLOSE_TIMEOUT_S: Final = 2.0


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


class ZenohSession:
    """A `zenoh.Session` whose `close` returns when no thread of Zenoh's runs Python any more.

    Each callback is called in a Python thread of its own, which ends some time after what it was declared for.
    One that is still there when the interpreter ends is unwound by it through Zenoh's code, and Rust answers that
    by aborting the process ("FATAL: exception not rethrown") although all had gone well. What is not here is the
    session's own.
    """

    def __init__(self, session: Any) -> None:
        self._session = session
        self._lock = threading.Lock()  # so that nothing is being declared while we close
        self._started = 0
        self._ending: queue.SimpleQueue[threading.Thread] = queue.SimpleQueue()

    def __getattr__(self, name: str) -> Any:
        """The session's own."""
        return getattr(self._session, name)

    def declare_subscriber(self, key: str, callback: Callable[[Any], None]) -> Any:
        """A subscriber. Raises SinkError when the session is closed."""
        with self._lock:
            return self._session.declare_subscriber(key, self._followed(callback))

    def declare_queryable(self, key: str, callback: Callable[[Any], None]) -> Any:
        """A queryable. Raises SinkError when the session is closed."""
        with self._lock:
            return self._session.declare_queryable(key, self._followed(callback))

    def watch_liveliness(self, key: str, callback: Callable[[Any], None]) -> Any:
        """A subscriber to liveliness tokens, told of those already there, too. Raises SinkError when closed."""
        with self._lock:
            return self._session.liveliness().declare_subscriber(key, self._followed(callback), history=True)

    def close(self) -> None:
        """Undeclare everything, and wait for the callbacks that run, though not for ever."""
        with self._lock:
            self._session.close()
            started, self._started = self._started, 0
        deadline = time.monotonic() + CLOSE_TIMEOUT_S
        for _ in range(started):
            with suppress(queue.Empty):  # stuck in a callback
                thread = self._ending.get(timeout=max(deadline - time.monotonic(), 0.0))
                thread.join(max(deadline - time.monotonic(), 0.0))

    def _followed(self, callback: Callable[[Any], None]) -> Any:
        """The callback, whose thread says so when it has nothing more to do."""
        import zenoh  # noqa: PLC0415 - loaded already: there is a session

        if self._session.is_closed():  # declaring would start a thread all the same
            raise SinkError("zenoh: the session is closed")
        self._started += 1
        return zenoh.handlers.Callback(callback, lambda: self._ending.put(threading.current_thread()))


def open_session(config: ZenohConfig) -> ZenohSession:
    """Open the session; blocks for some ten milliseconds (client and connect: until the peer answers).

    Raises SinkError: port in use, no router there, unreadable file.
    """
    import zenoh  # noqa: PLC0415 - replay never loads it

    try:
        return ZenohSession(zenoh.open(_zenoh_config(config)))
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

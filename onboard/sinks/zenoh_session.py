"""The one Zenoh session of a program: configuration, opening and closing."""

import queue
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, Literal

import msgspec

from onboard.messages import Record
from onboard.sinks.secrets import secret
from onboard.sinks.sink import SinkError

SECURE: Final = ("tls/", "quic/")
FORBIDDEN: Final = "*$?#/"
DEFAULT_LISTEN: Final = ("tcp/127.0.0.1:7447",)
CLOSE_TIMEOUT_S: Final = 2.0


class ZenohConfig(Record, frozen=True, kw_only=True):
    """Configuration of Zenoh. By default the program is a router on this computer's loopback interface only.

    The files of certificates and keys (PEM) and the password are for the endpoints of `connect`.
    `config_file` is a Zenoh JSON5 file for further settings (TLS, passwords, access control). It takes precedence;
    settings that it does not contain keep our defaults, `mode`, `listen` and `connect` included.
    """

    enabled: bool = True
    vehicle: str = "1"
    mode: Literal["router", "peer", "client"] = "router"
    listen: tuple[str, ...] | None = None  # None: `DEFAULT_LISTEN`, but nothing where TLS is used
    connect: tuple[str, ...] = ()
    max_message_size: int = 262_144  # bytes; Zenoh's own default would let a peer send us 1 GiB
    ca_file: str | None = None  # whose certificates are trusted
    certificate_file: str | None = None  # ours; its common name is `user`
    private_key_file: str | None = None
    user: str | None = None  # None: `vehicle`
    password_file: str | None = None
    config_file: str | None = None

    def __post_init__(self) -> None:
        """Raises ValueError for a vehicle that cannot be part of a key."""
        v = self.vehicle
        if not v or not v.isascii() or not v.isprintable() or any(c in FORBIDDEN or c.isspace() for c in v):
            raise ValueError(f"vehicle {v!r} cannot be part of a key: use letters, digits, - and _, such as uav-1")

    def listens(self, endpoints: Iterable[str] = ()) -> tuple[str, ...]:
        """The endpoints to listen on. With TLS among `connect` or further `endpoints`, none by default: a plain
        listener would be open to every program on this computer."""
        if self.listen is not None:
            return self.listen
        secure = any(e.lower().startswith(SECURE) for e in (*self.connect, *endpoints))
        return () if secure or self.mode == "client" else DEFAULT_LISTEN

    @property
    def prefix(self) -> str:
        """The beginning of all our keys."""
        return f"onboard/{self.vehicle}"


class ZenohSession:
    """A `zenoh.Session` whose `close` waits until no thread of Zenoh runs Python code. Other attributes are the
    session's.

    Zenoh calls each callback in its own Python thread, which ends some time after its subscriber or queryable. If
    such a thread still runs when the interpreter ends, the interpreter unwinds it through Zenoh's code, and Rust
    aborts the process ("FATAL: exception not rethrown") after a successful run.
    """

    def __init__(self, session: Any) -> None:
        self._session = session
        self._lock = threading.Lock()  # prevents declarations during `close`
        self._started = 0
        self._ending: queue.SimpleQueue[threading.Thread] = queue.SimpleQueue()

    def __getattr__(self, name: str) -> Any:
        """The session's attribute."""
        return getattr(self._session, name)

    def declare_subscriber(self, key: str, callback: Callable[[Any], None]) -> Any:
        """Declare a subscriber. Raises SinkError if the session is closed."""
        with self._lock:
            return self._session.declare_subscriber(key, self._counted(callback))

    def declare_queryable(self, key: str, callback: Callable[[Any], None]) -> Any:
        """Declare a queryable. Raises SinkError if the session is closed."""
        with self._lock:
            return self._session.declare_queryable(key, self._counted(callback))

    def watch_liveliness(self, key: str, callback: Callable[[Any], None]) -> Any:
        """Subscribe to liveliness tokens, existing ones included. Raises SinkError if the session is closed."""
        with self._lock:
            return self._session.liveliness().declare_subscriber(key, self._counted(callback), history=True)

    def close(self) -> None:
        """Undeclare everything, and wait at most `CLOSE_TIMEOUT_S` for running callbacks."""
        with self._lock:
            self._session.close()
            started, self._started = self._started, 0
        deadline = time.monotonic() + CLOSE_TIMEOUT_S
        for _ in range(started):
            with suppress(queue.Empty):  # a callback is stuck
                thread = self._ending.get(timeout=max(deadline - time.monotonic(), 0.0))
                thread.join(max(deadline - time.monotonic(), 0.0))

    def _counted(self, callback: Callable[[Any], None]) -> Any:
        """The callback; its thread is put into `_ending` when Zenoh drops it."""
        import zenoh  # noqa: PLC0415 - loaded already: there is a session

        if self._session.is_closed():  # a declaration would start a thread nevertheless
            raise SinkError("zenoh: the session is closed")
        self._started += 1
        return zenoh.handlers.Callback(callback, lambda: self._ending.put(threading.current_thread()))


def open_session(config: ZenohConfig) -> ZenohSession:
    """Open the session. Blocks for about ten milliseconds (with mode client or `connect`: until the peer answers).

    Raises SinkError: port in use, no router there, unreadable file.
    """
    import zenoh  # noqa: PLC0415 - replay never loads it

    try:
        return ZenohSession(zenoh.open(_zenoh_config(config)))
    except zenoh.ZError as error:
        raise SinkError(_explanation(config, str(error))) from error


def _explanation(config: ZenohConfig, error: str) -> str:
    """Zenoh's error in one line."""
    if "Address already in use" in error:
        return f"zenoh: {', '.join(config.listens())} is in use: is another router, or another onboard, running?"
    if config.mode == "client":
        refuses = " or it refuses us (certificate, user, password)" if config.ca_file else ""
        return f"zenoh: no router answers at {', '.join(config.connect) or 'any address: set connect'}{refuses}"
    reason = error.splitlines()[0].split(" at /")[0]  # the rest are places in Zenoh's sources
    return f"zenoh: cannot open a session ({reason})"


def _zenoh_config(config: ZenohConfig) -> Any:
    """The configuration in Zenoh's form. Raises SinkError if the file cannot be read."""
    import zenoh  # noqa: PLC0415 - replay never loads it

    untouched = zenoh.Config()
    try:
        result = zenoh.Config.from_file(config.config_file) if config.config_file else zenoh.Config()
    except zenoh.ZError as error:
        problem = "cannot be read as Zenoh JSON5" if Path(str(config.config_file)).exists() else "does not exist"
        raise SinkError(f"zenoh: config_file {config.config_file} {problem}") from error
    for key, value in _credentials(config).items():
        result.insert_json5(key, msgspec.json.encode(value).decode())
    in_file = [e for key in ("listen", "connect") for e in _endpoints(result, key)]
    ours = {
        "mode": config.mode,
        "listen/endpoints": [] if config.mode == "client" else list(config.listens(in_file)),
        "connect/endpoints": list(config.connect),
        # a router that comes back is found within 2 s; the default waits up to 4
        "connect/retry": {"period_init_ms": 500, "period_max_ms": 2000, "period_increase_factor": 2},
        "scouting/delay": 0,  # else opening would wait half a second for replies to scouting, which is off
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/link/rx/max_message_size": config.max_message_size,
        # Room for 0.1 s of estimates, so that a subscriber may be busy for a moment. When it is full, drop at once
        # instead of waiting 1 ms (50 for fragments) for a peer that does not read.
        "transport/link/tx/queue/size/data": 16,
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 0,
        "transport/link/tx/queue/congestion_control/drop/max_wait_before_drop_fragments": 0,
        # A killed process would leave segments behind, and our messages are too short to benefit.
        "transport/shared_memory/enabled": False,
    }
    for key, value in ours.items():
        if result.get_json(key) == untouched.get_json(key):
            result.insert_json5(key, msgspec.json.encode(value).decode())
    return result


def _credentials(config: ZenohConfig) -> dict[str, object]:
    """The settings that prove who we are to a router, and the router to us. Raises SinkError for a file that
    cannot be used."""
    settings: dict[str, object] = {}
    if config.private_key_file is not None:
        secret(config.private_key_file, "zenoh.private_key_file")
    for key, file in (
        ("root_ca_certificate", config.ca_file),
        ("connect_certificate", config.certificate_file),
        ("connect_private_key", config.private_key_file),
    ):
        if file is not None:
            if not Path(file).is_file():
                raise SinkError(f"zenoh: {file}: no such file")
            settings[f"transport/link/tls/{key}"] = file
    if config.certificate_file is not None:
        settings["transport/link/tls/enable_mtls"] = True
    if config.password_file is not None:
        settings["transport/auth/usrpwd/user"] = config.user or config.vehicle
        settings["transport/auth/usrpwd/password"] = secret(config.password_file, "zenoh.password_file")
    return settings


def _endpoints(config: Any, key: str) -> list[str]:
    """The endpoints of a Zenoh configuration, for any of its modes."""
    value = msgspec.json.decode(config.get_json(f"{key}/endpoints"))
    parts = value.values() if isinstance(value, dict) else [value]
    return [endpoint for part in parts if isinstance(part, list) for endpoint in part if isinstance(endpoint, str)]

"""The one Zenoh session of a program: configuration, opening and closing."""

import platform
import queue
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any, ClassVar, Final, Literal, NamedTuple

import msgspec
from yaml import YAMLError

from onboard.messages import Record
from onboard.messages.causes import NO_REASON, Cause, Reason
from onboard.messages.text import plain
from onboard.sinks.secrets import secret
from onboard.sinks.sink import SinkError
from onboard.sinks.zenoh_reach import NO_SESSION, Trust, diagnose, probe, worst
from onboard.sinks.zenoh_stated import is_stated, stated_in

SECURE: Final = ("tls/", "quic/")
FORBIDDEN_IN_KEY: Final = "*$?#/"
DEFAULT_LISTEN: Final = ("tcp/127.0.0.1:7447",)
SESSION_CLOSE_TIMEOUT_S: Final = 2.0
MAX_SESSION_COUNT: Final = 16  # of one name that are remembered
RIVAL_TIMEOUT_S: Final = 1.0
OUTSIDE_ADDRESS: Final = ("192.0.2.1", 9)  # RFC 5737; nothing is sent there
ROUTER_RETRY_PERIOD_S: Final = 0.5
TLS_SETTINGS: Final = (
    "root_ca_certificate",
    "connect_certificate",
    "connect_private_key",
    "verify_name_on_connect",
)


class Standing(NamedTuple):
    """Order of two sessions of one vehicle; the greater one keeps the name."""

    is_armed: bool
    age_s: float
    computer: str  # its name and address


class RouterAbsentError(SinkError):
    """No router answers a client, or not yet."""

    def __init__(self, words: str, cause: Cause = Cause.UNREACHABLE) -> None:
        super().__init__(words)
        self.cause = cause


class ZenohConfig(Record, frozen=True, kw_only=True):
    """Configuration of Zenoh; by default the program is a router on the loopback interface only.

    Certificates, keys (PEM) and password are for the endpoints of `connect`. `config_file` is a Zenoh JSON5 file
    for further settings (TLS, passwords, access control). Its settings take precedence, even if equal to Zenoh's
    defaults; for all others ours apply.
    """

    enabled: bool = True
    vehicle: str = "1"
    mode: Literal["router", "peer", "client"] = "router"
    listen: tuple[str, ...] | None = None  # None: `DEFAULT_LISTEN`, or nothing with TLS
    connect: tuple[str, ...] = ()
    max_message_size: ClassVar[int] = 262_144  # bytes; Zenoh's own default would let a peer send us 1 GiB
    ca_file: str | None = None  # the trusted authority
    certificate_file: str | None = None  # ours; its common name is `user`
    private_key_file: str | None = None
    user: str | None = None  # None: `vehicle`
    password_file: str | None = None
    config_file: str | None = None

    def __post_init__(self) -> None:
        """Raise ValueError for a vehicle that cannot be part of a key."""
        v = self.vehicle
        if not v or not v.isascii() or not v.isprintable() or any(c in FORBIDDEN_IN_KEY or c.isspace() for c in v):
            raise ValueError(f"vehicle {v!r} cannot be part of a key; use letters, digits, - and _, such as uav-1")

    def listens(self, endpoints: Iterable[str] = ()) -> tuple[str, ...]:
        """Return the endpoints to listen on.

        With TLS among `connect` or further `endpoints` there are none by default: a plain listener would be open
        to every program on this computer.
        """
        if self.listen is not None:
            return self.listen
        secure = any(e.lower().startswith(SECURE) for e in (*self.connect, *endpoints))
        return () if secure or self.mode == "client" else DEFAULT_LISTEN

    @property
    def prefix(self) -> str:
        """The beginning of all our keys."""
        return f"onboard/{self.vehicle}"


class ZenohSession:
    """A `zenoh.Session` whose `close` waits until no thread of Zenoh runs Python code.

    All other attributes are the session's. Zenoh calls each callback in its own Python thread, which ends some
    time after its subscriber or queryable. If such a thread still runs when the interpreter ends, the interpreter
    unwinds it through Zenoh's code, and Rust aborts the process ("FATAL: exception not rethrown") after a
    successful run.
    """

    def __init__(self, session: Any, settings: Any = None) -> None:
        self._session = session
        self.mode, self._trust = "", Trust()
        self.listening: tuple[str, ...] = ()
        self._connecting: tuple[str, ...] = ()
        if settings is not None:
            self.mode = _mode(settings)
            self.listening = tuple(_endpoints(settings, "listen", self.mode))
            self._connecting = tuple(_endpoints(settings, "connect", self.mode))
            self._trust = _trust(settings)
        self._opened_s = time.monotonic()
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
        """Subscribe to liveliness tokens, existing ones included.

        Raises SinkError if the session is closed.
        """
        with self._lock:
            return self._session.liveliness().declare_subscriber(key, self._counted(callback), history=True)

    def own_id(self) -> str:
        """Return the id of this session."""
        return str(self._session.info.zid())

    def declare_standing(self, prefix: str, is_armed: Callable[[], bool | None]) -> Any:
        """Answer other sessions that claim the vehicle of `prefix`. Raises SinkError if the session is closed.

        `is_armed` is None until an autopilot has been heard; Zenoh's threads call it.
        """
        key = f"{prefix}/alive/{self.own_id()}"

        def answer(query: Any) -> None:
            with query:
                standing = Standing(bool(is_armed()), self.age_s(), this_computer())
                query.reply(key, msgspec.json.encode(standing))

        return self.declare_queryable(key, answer)

    def find_rivals(self, prefix: str) -> dict[str, Standing]:
        """Return other sessions that claim the vehicle of `prefix`, by id. It may take `RIVAL_TIMEOUT_S`."""
        found: dict[str, Standing] = {}
        for reply in self._session.get(f"{prefix}/alive/*", timeout=RIVAL_TIMEOUT_S):
            session = "" if reply.ok is None else plain(str(reply.ok.key_expr).rpartition("/")[2])
            if session not in ("", self.own_id()) and len(found) < MAX_SESSION_COUNT:
                with suppress(msgspec.DecodeError):
                    standing = msgspec.json.decode(reply.ok.payload.to_bytes(), type=Standing)
                    found[session] = standing._replace(computer=plain(standing.computer))
        return found

    def age_s(self) -> float:
        """Return the time since the session was opened, s."""
        return time.monotonic() - self._opened_s

    def trouble(self) -> Reason:
        """Return the unreachable endpoints of `connect`, or NO_REASON. May take seconds."""
        return NO_REASON if self._session.is_closed() else diagnose(self._connecting, self._session, self._trust)

    def words(self) -> str:
        """Describe the session: its mode, and the endpoints where it listens and connects."""
        where = ", ".join(self.listening) or "no plain listener"
        return f"{self.mode} at {where}" + (f", to {', '.join(self._connecting)}" if self._connecting else "")

    def close(self) -> None:
        """Undeclare everything, and wait at most `SESSION_CLOSE_TIMEOUT_S` for running callbacks."""
        import zenoh  # noqa: PLC0415 - loaded already: there is a session

        with self._lock:
            with suppress(zenoh.ZError):  # what answers, but is no router, may hold it up; it is closed then, too
                self._session.close()
            started, self._started = self._started, 0
        deadline = time.monotonic() + SESSION_CLOSE_TIMEOUT_S
        for _ in range(started):
            with suppress(queue.Empty):  # a callback is stuck
                thread = self._ending.get(timeout=max(deadline - time.monotonic(), 0.0))
                thread.join(max(deadline - time.monotonic(), 0.0))

    def _counted(self, callback: Callable[[Any], None]) -> Any:
        """Wrap the callback, so that its thread is put into `_ending` when Zenoh drops it."""
        import zenoh  # noqa: PLC0415 - loaded already: there is a session

        if self._session.is_closed():  # a declaration would start a thread nevertheless
            raise SinkError("zenoh: the session is closed")
        self._started += 1
        return zenoh.handlers.Callback(callback, lambda: self._ending.put(threading.current_thread()))


def this_computer() -> str:
    """Return the name of this computer, and its address towards others if it has one."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe_socket, suppress(OSError):
        probe_socket.connect(OUTSIDE_ADDRESS)
        return f"{platform.node()} ({probe_socket.getsockname()[0]})"
    return platform.node()


def open_session(config: ZenohConfig) -> ZenohSession:
    """Open the session.

    It blocks for about ten milliseconds, or with mode client or `connect` until the peer answers. Raises SinkError
    for a port in use or an unreadable file, and RouterAbsentError if a client's router does not answer.
    """
    import zenoh  # noqa: PLC0415 - replay never loads it

    settings = _zenoh_config(config)
    try:
        return ZenohSession(zenoh.open(settings), settings)
    except zenoh.ZError as error:
        raise _explained(settings, str(error)) from error


def wait_for_session(config: ZenohConfig, wait_s: float) -> ZenohSession:
    """Open the session, and wait at most `wait_s` seconds for a client's router.

    A line on standard error says so; a rejected certificate is reported at once. Raises SinkError as
    `open_session` does.
    """
    begin, lines = time.monotonic(), iter(["waiting for it"])
    while True:
        try:
            return open_session(config)
        except RouterAbsentError as error:
            if error.cause is Cause.TLS or time.monotonic() - begin >= wait_s:
                raise
            for line in lines:  # once
                print(f"{error}; {line}", file=sys.stderr, flush=True)
            time.sleep(ROUTER_RETRY_PERIOD_S)


def _explained(settings: Any, error: str) -> SinkError:
    """Return Zenoh's error in one line."""
    mode = _mode(settings)
    if "Address already in use" in error:
        where = ", ".join(_endpoints(settings, "listen", mode))
        return SinkError(f"zenoh: {where} is in use; stop the other router or onboard, or change zenoh.listen")
    if mode == "client":
        endpoints = _endpoints(settings, "connect", mode)
        if not endpoints:
            return SinkError("zenoh: a client needs the address of a router; set zenoh.connect")
        trust = _trust(settings)
        found = {e: probe(e, trust) for e in endpoints}
        why = ", ".join(f"{e}: {(reason or NO_SESSION).words}" for e, reason in found.items())
        words = f"zenoh: no router answers at {', '.join(endpoints)} ({why})"
        return RouterAbsentError(words, worst((reason or NO_SESSION).cause for reason in found.values()))
    reason = error.splitlines()[0].split(" at /")[0]  # the rest are places in Zenoh's sources
    return SinkError(f"zenoh: cannot open a session ({reason})")


def _zenoh_config(config: ZenohConfig) -> Any:
    """Return the configuration in Zenoh's form, with the file's settings over ours.

    Raises SinkError if the file cannot be read, or if Zenoh rejects an endpoint.
    """
    import zenoh  # noqa: PLC0415 - replay never loads it

    path, stated = config.config_file, frozenset[str]()
    try:
        result = zenoh.Config.from_file(path) if path else zenoh.Config()
        stated = stated_in(path) if path else stated
    except (zenoh.ZError, OSError, ValueError, YAMLError) as error:
        problem = "cannot be read as Zenoh JSON5" if Path(str(path)).exists() else "does not exist"
        raise SinkError(f"zenoh: config_file {path} {problem}") from error
    for key, value in _ours(config, result, stated).items():
        if isinstance(value, dict) and is_stated(key, stated):  # a part of it may be
            theirs = msgspec.json.decode(result.get_json(key)) or {}
            value |= {name: theirs[name] for name in theirs if is_stated(f"{key}/{name}", stated)}
        elif is_stated(key, stated):
            continue
        written = msgspec.json.encode(value).decode()
        try:
            result.insert_json5(key, written)
        except zenoh.ZError as error:
            raise SinkError(f"zenoh: {key} cannot be {written}; an endpoint is like tcp/127.0.0.1:7447") from error
    return result


def _ours(config: ZenohConfig, theirs: Any, stated: frozenset[str]) -> dict[str, Any]:
    """Return our settings, for everything that the file does not set."""
    stated_of = {key: _endpoints(theirs, key) if is_stated(key, stated) else [] for key in ("listen", "connect")}
    listens, connects = stated_of.values()
    mode = msgspec.json.decode(theirs.get_json("mode")) if is_stated("mode", stated) else config.mode
    return {
        **_credentials(config),
        "mode": config.mode,
        "listen/endpoints": [] if mode == "client" else list(config.listens([*listens, *connects])),
        "connect/endpoints": list(config.connect),
        # a returning router is found within half a second on this computer, since a camera is blind meanwhile,
        # otherwise within 2 s; the default waits up to 4
        "connect/retry": {
            "period_init_ms": 200,
            "period_max_ms": 500 if all(map(_is_here, connects or config.connect)) else 2000,
            "period_increase_factor": 2,
        },
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


def _is_here(endpoint: str) -> bool:
    """Whether an endpoint is on this computer."""
    return any(name in endpoint for name in ("127.0.0.1", "localhost", "[::1]"))


def _mode(settings: Any) -> str:
    """Return the mode of a Zenoh configuration."""
    return str(msgspec.json.decode(settings.get_json("mode")))


def _trust(settings: Any) -> Trust:
    """Return the TLS settings of a Zenoh configuration."""
    key = "transport/link/tls"
    tls = {name: msgspec.json.decode(settings.get_json(f"{key}/{name}")) for name in TLS_SETTINGS}
    ca, certificate, private_key, checks_name = tls.values()
    return Trust(ca, certificate, private_key, checks_name is not False)


def _credentials(config: ZenohConfig) -> dict[str, object]:
    """Return the settings for mutual authentication with a router.

    Raises SinkError for an unusable file.
    """
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


def _endpoints(config: Any, key: str, mode: str = "") -> list[str]:
    """Return the endpoints of a Zenoh configuration, for this mode, or for any."""
    value = msgspec.json.decode(config.get_json(f"{key}/endpoints"))
    parts = (
        [part for name, part in value.items() if not mode or name == mode] if isinstance(value, dict) else [value]
    )
    return [endpoint for part in parts if isinstance(part, list) for endpoint in part if isinstance(endpoint, str)]

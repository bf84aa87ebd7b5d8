"""The router of a fleet: its users, and the keys that each may use.

Each client needs a certificate of the fleet's authority and a password; the certificate's common name is the
user's name. A vehicle may use only the keys below `onboard/<its name>/`. A watcher, such as a ground station, may
read the keys of all vehicles and write none.
"""

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

import msgspec

from onboard.messages import Record
from onboard.sinks.secrets import secret
from onboard.sinks.sink import SinkError
from onboard.sinks.zenoh_session import FORBIDDEN_IN_KEY, ZenohSession

MAX_MESSAGE_BYTES: Final = 262_144
MIN_SESSION_COUNT: Final = 1000  # allowed at once; two per user if that is more
READER_MESSAGES: Final = ("declare_subscriber", "query", "liveliness_query", "declare_liveliness_subscriber")
BACKWARD_MESSAGES: Final = ("put", "delete", "reply", "liveliness_token")  # messages that flow back to a reader
OWNER_MESSAGES: Final = (*READER_MESSAGES, *BACKWARD_MESSAGES, "declare_queryable")
# Log levels that `refusal` needs. Zenoh logs to standard output.
LOG_FILTER: Final = (
    "off,zenoh_link_tls::unicast=warn,zenoh_transport::unicast::establishment::accept=debug,"
    "zenoh::net::routing::interceptor::access_control=trace"
)
_NOT_ALLOWED: Final = re.compile(r"CertCommonName\(([^)]*)\).* is unauthorized to .+ \(ingress\) on (\S+)")
_ACCEPT: Final = re.compile(r"establishment::accept: UsrPwd extension - .*?(Invalid \w+|Expected extension)")
_TLS: Final = re.compile(r"WARN .*zenoh_link_tls::unicast: (.+?)\.?(?: Hint: .*)?$")


class RouterConfig(Record, frozen=True, kw_only=True):
    """`[router]`: the router of a fleet.

    Files are PEM; `users_file` has a line NAME:PASSWORD for each user.
    """

    listen: tuple[str, ...] = ("tls/127.0.0.1:7447",)
    ca_file: str = "certs/ca.pem"  # the trusted authority
    certificate_file: str = "certs/router.pem"
    private_key_file: str = "certs/router.key"
    users_file: str = "certs/users.txt"
    watchers: tuple[str, ...] = ("ground",)  # users who may read everything; all others are vehicles

    def __post_init__(self) -> None:
        """Raise ValueError for an endpoint without TLS, which would expose a password."""
        for endpoint in self.listen:
            if not endpoint.startswith(("tls/", "quic/")):
                raise ValueError(f"listen {endpoint!r} must begin with tls/ or quic/, since passwords are sent")


def open_router(config: RouterConfig) -> ZenohSession:
    """Start routing. Raises SinkError for an unusable file, and for a port in use."""
    import zenoh  # noqa: PLC0415 - only the router loads it here

    settings = zenoh.Config()
    for key, value in router_settings(config, users(config.users_file)).items():
        settings.insert_json5(key, msgspec.json.encode(value).decode())
    try:
        return ZenohSession(zenoh.open(settings))
    except zenoh.ZError as error:
        reason = str(error).splitlines()[0].split(" at /")[0]
        if "Address already in use" in str(error):
            reason = f"{', '.join(config.listen)} is in use"
        raise SinkError(f"router: {reason}") from error


def users(path: str) -> tuple[str, ...]:
    """Return the names in a file of users. Raises SinkError."""
    names = []
    for number, line in enumerate(secret(path, "router.users_file").splitlines(), 1):
        name, colon, password = line.partition(":")
        if not colon or not name or not password or any(c in FORBIDDEN_IN_KEY or c.isspace() for c in name):
            raise SinkError(f"router.users_file {path}: line {number} is not NAME:PASSWORD")
        names.append(name)
    if len(set(names)) < len(names):
        raise SinkError(f"router.users_file {path}: a name occurs twice; remove one of its lines")
    return tuple(names)


def router_settings(config: RouterConfig, names: Iterable[str]) -> dict[str, Any]:
    """Return Zenoh's settings for these users.

    Raises SinkError for a missing file, and for an unknown watcher.
    """
    names = tuple(names)
    for file in (config.ca_file, config.certificate_file):
        if not Path(file).is_file():
            raise SinkError(f"router: {file}: no such file")
    secret(config.private_key_file, "router.private_key_file")
    for watcher in config.watchers:
        if watcher not in names:
            raise SinkError(f"router.watchers: {watcher} is not in {config.users_file}")
    return {
        "mode": "router",
        "listen/endpoints": config.listen,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/unicast/max_sessions": max(MIN_SESSION_COUNT, 2 * len(names)),
        "transport/link/rx/max_message_size": MAX_MESSAGE_BYTES,
        "transport/link/tls": {
            "root_ca_certificate": config.ca_file,
            "listen_certificate": config.certificate_file,
            "listen_private_key": config.private_key_file,
            "enable_mtls": True,
        },
        # without a user of its own, Zenoh would not ask others for theirs
        "transport/auth/usrpwd": {"user": "router", "password": "-", "dictionary_file": config.users_file},
        "transport/shared_memory/enabled": False,
        "access_control": _access(names, config.watchers),
    }


def _access(names: Iterable[str], watchers: Iterable[str]) -> dict[str, Any]:
    """Return Zenoh's access control, which denies by default."""
    vehicles = [name for name in names if name not in set(watchers)]
    watching = [
        _rule("watch", READER_MESSAGES, "onboard/**", ("ingress",)),
        _rule("be-sent", BACKWARD_MESSAGES, "onboard/**", ("egress",)),
    ]
    own = [_rule(f"own-{v}", OWNER_MESSAGES, f"onboard/{v}/**", ("ingress", "egress")) for v in vehicles]
    # A vehicle sends only subscribed keys, and a watcher's `onboard/*/health` is not a key of one vehicle.
    asked = _rule("be-asked", READER_MESSAGES, "onboard/**", ("egress",))
    policies = [{"rules": [f"own-{v}", "be-asked"], "subjects": [v]} for v in vehicles]
    if watchers := tuple(watchers):
        policies.append({"rules": ["watch", "be-sent"], "subjects": list(watchers)})
    everybody = (*vehicles, *watchers)
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [asked, *own, *(watching if watchers else ())],
        "subjects": [{"id": n, "cert_common_names": [n], "usernames": [n]} for n in everybody],
        "policies": policies,
    }


def _rule(name: str, messages: tuple[str, ...], keys: str, flows: tuple[str, ...]) -> dict[str, Any]:
    return {"id": name, "permission": "allow", "messages": messages, "flows": flows, "key_exprs": [keys]}


def refusal(line: str, watchers: Iterable[str]) -> str | None:
    """Return the refusal in a line of Zenoh's log, or None for other lines.

    Zenoh checks watchers' rights in advance, and its log does not distinguish their attempts from these checks, so
    they are left out.
    """
    if found := _NOT_ALLOWED.search(line):
        name, key = found.groups()
        is_foreign = not f"{key}/".startswith(f"onboard/{name}/")
        is_whole = key.count("/") > 1  # else the part of a key that Zenoh sends ahead
        return f"{name}: {key}" if is_foreign and is_whole and name not in set(watchers) else None
    if found := _ACCEPT.search(line):
        return f"a connection: {'no password' if found[1].startswith('Expected') else found[1].lower()}"
    if found := _TLS.search(line):
        return f"a connection: {found[1]}"
    return None

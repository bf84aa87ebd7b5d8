"""Why no daemon answers: what this computer shows of ports, certificates and storage. Used by `onboard
status`."""

import errno
import os
import shutil
import socket
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final

from onboard.config import Config
from onboard.health.causes_host import MIN_STORAGE_BYTES
from onboard.messages import Advice, Severity
from onboard.messages.causes import Cause, Reason

PROC: Final = Path("/proc")


def why_absent(
    config: Config, endpoint: str, error: Reason, vehicle: str = "", unread: int = 0
) -> tuple[Advice, ...]:
    """Advice where no daemon answers at `endpoint`; `error`: Zenoh's, NO_REASON where one answers, but
    sends no health; `unread`: records that came from there and could not be read."""
    if unread:
        what = f"{unread} records from {endpoint} cannot be read: a daemon of another version"
        return (_error("daemon", what, "use the `onboard` of that daemon's version: `onboard --version`"),)
    if not error.words:
        what = f"no daemon of vehicle {vehicle or config.zenoh.vehicle} publishes at {endpoint}"
        remedy = "`--vehicle all` shows all there are; else start `onboard run CONFIG.toml`"
        return (_error("daemon", what, remedy),)
    found = [*_ports(config, endpoint), *_storage(config)]
    if error.cause is Cause.TLS:
        remedy = "check `ca_file`, `certificate_file`, `private_key_file` of [zenoh], the clock, and `--config`"
        return (_error("tls", f"{endpoint}: {error.words}", remedy), *found)
    if any(advice.kind == "daemon" for advice in found):
        return tuple(found)
    remedy = "start `onboard run CONFIG.toml`, or set `--connect`"
    if config.zenoh.enabled and not config.zenoh.listens():
        remedy += '; `listen = ["tcp/127.0.0.1:7447"]` of [zenoh] lets this computer ask its own daemon'
    return (*found, _error("daemon", f"no daemon answers at {endpoint}", remedy))


def _ports(config: Config, endpoint: str) -> Iterator[Advice]:
    """Ports that the daemon would listen on, and that another program has, or the daemon itself."""
    for link in config.link:
        kind, _, where = link.url.partition(":")
        if kind in ("udpin", "json", "tcpin"):
            key = f"`url` of [[link]] {link.name}"
            yield from _taken(f"link {link.name}", where, endpoint, is_tcp=kind == "tcpin", key=key)
    for listening in config.zenoh.listens() if config.zenoh.enabled else ():
        if listening.startswith("tcp/"):
            yield from _taken("Zenoh", listening[4:], endpoint, is_tcp=True, key="`listen` of [zenoh]")


def _taken(what: str, where: str, endpoint: str, *, is_tcp: bool, key: str) -> Iterator[Advice]:
    host, _, text = where.rpartition(":")
    host, port = host.strip("[]"), int(text)
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM if is_tcp else socket.SOCK_DGRAM) as probe:
        if is_tcp:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                return
        else:
            return
    name, process = holder(port, is_tcp=is_tcp)
    who = f"{name} (process {process})" if name else "another program"
    if _is_daemon(process):
        yield _error(
            "daemon",
            f"{who} is a daemon, and has port {port} of {what}, but publishes nothing at {endpoint}",
            "`enabled`, `listen` and `connect` of [zenoh] say where it publishes: name its file as `--config`, or "
            "set `--connect`",
        )
        return
    yield _error("port", f"{what}: port {port} of {host} is in use by {who}", f"end that program, or change {key}")


def _is_daemon(process: str) -> bool:
    """Whether a process is an `onboard run`."""
    with suppress(OSError):
        words = (PROC / process / "cmdline").read_bytes().split(b"\0")
        return b"run" in words and any(Path(os.fsdecode(word)).name == "onboard" for word in words)
    return False


def holder(port: int, *, is_tcp: bool) -> tuple[str, str]:
    """Which program has a port, as far as Linux shows it to us: its name and process id, or ("", "")."""
    inodes = set()
    for name in ("tcp", "tcp6") if is_tcp else ("udp", "udp6"):
        with suppress(OSError):
            for words in map(str.split, (PROC / "net" / name).read_text().splitlines()[1:]):
                is_listening = not is_tcp or words[3] == "0A"
                if is_listening and int(words[1].rpartition(":")[2], 16) == port:
                    inodes.add(f"socket:[{words[9]}]")
    for process in PROC.glob("[0-9]*"):
        with suppress(OSError):
            for opened in (process / "fd").iterdir():
                with suppress(OSError):
                    if str(opened.readlink()) in inodes:
                        return (process / "comm").read_text().strip(), process.name
    return "", ""


def _storage(config: Config) -> Iterator[Advice]:
    """A disk on which nothing can be recorded."""
    if config.recorder.path is None:
        return
    folder = Path(config.recorder.path).absolute().parent
    with suppress(OSError):
        free = shutil.disk_usage(folder).free
        if free < MIN_STORAGE_BYTES:
            what = f"{free / 1e6:.0f} MB are free where {config.recorder.path} is recorded"
            yield _error("disk", what, "make room (`df -h`, `du -sh *`), or set `path` of [recorder]")
        elif not os.access(folder, os.W_OK):
            yield _error("disk", f"{folder} cannot be written to", "set `path` of [recorder], or its permissions")


def _error(cause: str, what: str, remedy: str) -> Advice:
    return Advice(kind=cause, severity=Severity.ERROR, about="daemon", what=what, remedy=remedy, text=what[:50])

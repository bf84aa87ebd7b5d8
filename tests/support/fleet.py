"""A fleet's certificates, its router as a process, and sessions of its members."""

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from onboard.sinks.zenoh_session import ZenohConfig, ZenohSession, open_session
from tests.support.programs import ROOT, Program, started

SCRIPT = ROOT / "configs" / "make-test-certificates.sh"


def make_certificates(folder: Path, *names: str) -> None:
    """With the script that ships."""
    subprocess.run([SCRIPT, folder, *names], check=True, capture_output=True, timeout=60)


def files(certs: Path, name: str) -> dict[str, Any]:
    """The keys of `[zenoh]` that prove to be `name`."""
    return {
        "ca_file": str(certs / "ca.pem"),
        "certificate_file": str(certs / f"{name}.pem"),
        "private_key_file": str(certs / f"{name}.key"),
        "password_file": str(certs / f"{name}.password"),
        "user": name,
    }


def member(port: int, certs: Path, name: str, **changes: Any) -> ZenohSession:
    """A session of a member of the fleet, some of whose files may be changed.

    Raises SinkError if refused.
    """
    settings = files(certs, name) | changes
    return open_session(ZenohConfig(mode="client", connect=(f"tls/127.0.0.1:{port}",), **settings))


@contextmanager
def router(folder: Path, port: int, log: str = "router.log") -> Iterator[Program]:
    """`onboard router` with the file that ships, in the folder that has `certs`."""
    listen = f"router.listen=['tls/127.0.0.1:{port}']"
    command = ("onboard", "router", ROOT / "configs" / "router.toml", "--set", listen)
    with started(folder / log, *command, cwd=folder) as program:
        program.wait_for("router: tls")
        yield program

"""A fleet: real certificates, the real router, and members that are not what they say."""

import signal
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from onboard import UserError
from onboard.messages import Health
from onboard.sinks import SinkError
from onboard.sinks.zenoh_router import RouterConfig, router_settings, users
from onboard.sinks.zenoh_session import ZenohConfig
from onboard.view.client import Client
from tests.support.fleet import files, make_certificates, member, router
from tests.support.programs import ROOT, Program, free_ports, started, until

NAMES = ("uav-1", "uav-2", "uav-7", "ground")
POINTS = "onboard/uav-1/camera/front/points"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fleet")
    make_certificates(folder / "certs", *NAMES)
    make_certificates(folder / "strangers", "uav-1")
    return folder


@pytest.fixture
def port() -> int:
    (port,) = free_ports(socket.SOCK_STREAM)
    return port


@pytest.fixture
def running(folder: Path, port: int) -> Iterator[Program]:
    with router(folder, port) as program:
        yield program


def keys_of(session: Any, pattern: str) -> list[str]:
    got: list[str] = []
    session.declare_subscriber(pattern, lambda sample: got.append(str(sample.key_expr)))
    return got


def test_nobody_enters_without_certificate_and_password(folder: Path, port: int, running: Program) -> None:
    certs, strangers = folder / "certs", folder / "strangers"
    mine, theirs = files(certs, "uav-1"), files(strangers, "uav-1")
    wrong = {
        "no certificate": {"certificate_file": None, "private_key_file": None},
        "of another authority": {k: theirs[k] for k in ("certificate_file", "private_key_file")},
        "another's password": {"password_file": files(certs, "uav-2")["password_file"]},
        "no password": {"password_file": None},
        "unknown user": {"user": "uav-3"},
    }
    for change in wrong.values():
        with pytest.raises(SinkError, match="no router answers"):
            member(port, certs, "uav-1", **change)
    with pytest.raises(SinkError):  # of another authority is also the router, for those who trust only that one
        member(port, certs, "uav-1", ca_file=theirs["ca_file"])
    member(port, certs, "uav-1", **mine).close()
    for line in (
        "a connection: peer sent no certificates",
        "no password",
        "invalid password",
        "invalid user",
        "BadSign",
    ):
        running.wait_for(line)
    assert running.end() == 0
    assert int(running.output().rsplit("refused: ", 1)[1]) >= len(wrong)


def test_each_vehicle_has_its_own_keys_and_a_watcher_reads_all(folder: Path, port: int, running: Program) -> None:
    certs = folder / "certs"
    sessions = {name: member(port, certs, name) for name in ("uav-1", "uav-2", "ground")}
    impostor = member(port, certs, "uav-1", user="uav-2", password_file=str(certs / "uav-2.password"))
    try:
        running.wait_for("ground has connected")
        at_ground = keys_of(sessions["ground"], "onboard/**")
        at_1 = keys_of(sessions["uav-1"], "onboard/uav-1/camera/*/points")
        foreign = keys_of(sessions["uav-1"], "onboard/uav-2/**")
        until(lambda: sessions["uav-1"].put("onboard/uav-1/ready", b"") or at_ground, "uav-1's key")
        sessions["uav-1"].put("onboard/uav-2/health", b"foreign")
        sessions["uav-2"].put(POINTS, b"foreign")
        sessions["ground"].put(POINTS, b"foreign")
        for key in ("onboard/uav-1/health", "onboard/uav-2/health"):
            impostor.put(key, b"neither one nor two")
        running.wait_for("refused uav-1: onboard/uav-2/health")
        running.wait_for(f"refused uav-2: {POINTS}")
        running.wait_for("refused uav-1: onboard/uav-2/**")
        # What comes after them on the same connections has come: those before would have, too.
        sessions["uav-1"].put("onboard/uav-1/last", b"")
        sessions["uav-2"].put("onboard/uav-2/last", b"")
        until(lambda: {"onboard/uav-1/last", "onboard/uav-2/last"} <= set(at_ground), "the last keys")
        # A session hears itself without the router.
        assert {k for k in at_ground if k.split("/")[2] not in {"ready", "last"}} == {POINTS}
        assert (at_1, foreign) == ([], ["onboard/uav-2/health"])
    finally:
        for session in (*sessions.values(), impostor):
            session.close()
    assert running.end(signal.SIGINT) == 0


def test_a_daemon_is_seen_at_the_ground_and_again_after_the_router_died(folder: Path, port: int) -> None:
    """Its session outlives the router: health comes again without a restart of the daemon."""
    (mavlink,) = free_ports(socket.SOCK_DGRAM)
    link = f"link=[{{name='autopilot', url='udpin:127.0.0.1:{mavlink}'}}]"
    settings = ("--set", link, "--set", f"zenoh.connect=['tls/127.0.0.1:{port}']")
    credentials = ZenohConfig(**files(folder / "certs", "ground"))

    def first_health() -> int:
        """When the first record was published that comes once the ground has connected."""
        client = until(lambda: connected(credentials, port), "the router")
        try:
            assert client.alive.wait(60)
            received = client.take(60)
        finally:
            client.close()
        assert isinstance(received.record, Health)
        assert received.vehicle == "uav-7"
        return int(received.t_publish_ns)

    command = ("onboard", "run", ROOT / "configs" / "fleet.toml", *settings)
    with started(folder / "daemon.log", *command, cwd=folder) as daemon:
        with router(folder, port, "first.log"):
            before = first_health()
        with router(folder, port, "second.log"):
            assert first_health() > before
        assert daemon.end() == 0


def connected(credentials: ZenohConfig, port: int) -> Client | None:
    try:
        return Client(f"tls/127.0.0.1:{port}", None, credentials)
    except UserError:
        return None


@pytest.mark.parametrize("text", ["uav-1", "uav-1:", ":x", "a/b:x", "uav-1:x\nuav-1:y"])
def test_a_list_of_users_that_is_none_is_one_clear_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / "users.txt"
    path.write_text(text)
    path.chmod(0o600)
    with pytest.raises(SinkError, match=r"is not NAME:PASSWORD|occurs twice"):
        users(str(path))
    path.chmod(0o640)
    with pytest.raises(SinkError, match="others can read it"):
        users(str(path))


def test_a_router_needs_its_files_its_watchers_and_tls(folder: Path) -> None:
    certs = folder / "certs"
    config = RouterConfig(
        ca_file=str(certs / "ca.pem"),
        certificate_file=str(certs / "router.pem"),
        private_key_file=str(certs / "router.key"),
    )
    names = users(str(certs / "users.txt"))
    assert names == NAMES
    router_settings(config, names)
    with pytest.raises(SinkError, match="ground is not in"):
        router_settings(config, names[:-1])
    with pytest.raises(SinkError, match="no such file"):
        router_settings(RouterConfig(ca_file="nowhere.pem"), names)
    with pytest.raises(ValueError, match="must begin with tls/"):
        RouterConfig(listen=("tcp/127.0.0.1:7447",))

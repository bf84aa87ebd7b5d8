"""A router that is away, not a router, expired or foreign is named, and so is one that comes."""

import asyncio
import socket
from pathlib import Path

import pytest

from onboard.daemon import Daemon
from onboard.messages import NO_REASON, Cause
from onboard.sinks.zenoh_reach import Trust, probe
from onboard.sinks.zenoh_session import RouterAbsentError, ZenohConfig, open_session
from tests.support.fleet import files, make_certificates, router
from tests.support.programs import free_endpoint
from tests.support.programs import until as waited_for
from tests.support.running_link import until
from tests.support.streams import make_config


def test_a_router_that_is_away_is_named_until_it_is_there() -> None:
    endpoint = free_endpoint()
    ours = open_session(ZenohConfig(mode="peer", listen=(), connect=(endpoint,)))
    try:
        assert ours.trouble() == (Cause.UNREACHABLE, f"cannot reach {endpoint} (Connection refused)")
        theirs = open_session(ZenohConfig(listen=(endpoint,)))
        try:
            waited_for(lambda: ours.trouble() == NO_REASON, "a router")
        finally:
            theirs.close()
        waited_for(lambda: "Connection refused" in ours.trouble().words, "its loss")
    finally:
        ours.close()


def test_what_answers_but_is_no_router_is_named() -> None:
    server = socket.create_server(("127.0.0.1", 0))
    endpoint = f"tcp/127.0.0.1:{server.getsockname()[1]}"
    ours = open_session(ZenohConfig(mode="peer", listen=(), connect=(endpoint,)))
    try:
        assert "opens no session" in ours.trouble().words
    finally:
        server.close()  # first: Zenoh waits for what it has begun
        ours.close()


def test_a_client_s_absent_router_may_come_later() -> None:
    endpoint = free_endpoint()
    with pytest.raises(RouterAbsentError, match=rf"no router answers at {endpoint} \(.*Connection refused"):
        open_session(ZenohConfig(mode="client", connect=(endpoint,)))


def test_a_foreign_router_and_a_certificate_that_it_does_not_know_are_named(tmp_path: Path) -> None:
    for folder in ("ours", "theirs"):
        (tmp_path / folder).mkdir()
        make_certificates(tmp_path / folder / "certs", "ground", "uav-1")
    port = int(free_endpoint().rpartition(":")[2])
    endpoint = f"tls/127.0.0.1:{port}"
    certs = files(tmp_path / "ours" / "certs", "uav-1")
    ours = Trust(certs["ca_file"], certs["certificate_file"], certs["private_key_file"])
    theirs = ours._replace(ca_file=str(tmp_path / "theirs" / "certs" / "ca.pem"))
    with router(tmp_path / "ours", port):
        assert probe(endpoint, ours) is None
        foreign = probe(endpoint, theirs) or NO_REASON
        assert foreign.cause is Cause.TLS
        assert foreign.words.startswith("its certificate is not accepted: ")
        other = files(tmp_path / "theirs" / "certs", "uav-1")
        stranger = Trust(certs["ca_file"], other["certificate_file"], other["private_key_file"])
        unknown = probe(endpoint, stranger) or NO_REASON
        assert unknown.cause is Cause.TLS
        assert "TLS: " in unknown.words


@pytest.mark.parametrize("mode", ["peer", "client"])
def test_the_daemon_names_its_router_that_is_away_and_the_one_that_comes(mode: str) -> None:
    endpoint = free_endpoint()
    settings = ("link=[]", f"zenoh.mode={mode}", "zenoh.listen=[]", f"zenoh.connect=['{endpoint}']")
    lines: list[str] = []
    daemon = Daemon(make_config(*settings), report=lines.append)

    async def fly() -> None:
        task = asyncio.create_task(daemon.run())
        await until(lambda: any(endpoint in line and "Connection refused" in line for line in lines))
        assert any("retrying" in line or "trying again" in line for line in lines)
        theirs = await asyncio.to_thread(open_session, ZenohConfig(listen=(endpoint,)))
        seen = len(lines)
        word = "link zenoh: connected" if mode == "peer" else f"to {endpoint}, onboard/1"
        await until(lambda: any(word in line for line in lines[seen:]))
        task.cancel()
        await asyncio.wait({task})
        await asyncio.to_thread(theirs.close)

    asyncio.run(fly())

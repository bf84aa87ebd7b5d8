"""The one Zenoh session of a program: its configuration, its error messages and its end."""

import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from onboard.sinks import SinkError
from onboard.sinks.zenoh_session import ZenohConfig, open_session
from tests.support.programs import environment, free_endpoint

# Python takes a second to end, during which a callback in a thread that it does not wait for wants to go on.
ENDS_IN_A_CALLBACK = """
import sys, threading, time
from onboard.sinks.zenoh_session import ZenohConfig, open_session

class Lingering:
    sleep = time.sleep
    def __del__(self):
        self.sleep(1.0)

def callback(sample):
    called.set()
    time.sleep(0.5)

called = threading.Event()
sys.lingering = Lingering()  # sys is emptied late
session = open_session(ZenohConfig(vehicle="a", listen=(sys.argv[1],)))
daemon = threading.Thread(target=session.declare_subscriber, args=("a/b", callback), daemon=True)
daemon.start()
daemon.join()
session.put("a/b", b"x")
assert called.wait(10)
session.close()
"""


def config(endpoint: str, **options: Any) -> ZenohConfig:
    return ZenohConfig(vehicle="uav-1", listen=(endpoint,), **options)


def test_a_program_that_ends_in_a_callback_ends_well() -> None:
    command = [sys.executable, "-c", ENDS_IN_A_CALLBACK, free_endpoint()]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False, env=environment())
    assert (ended.returncode, ended.stderr) == (0, "")


def test_no_thread_of_a_session_outlives_it() -> None:
    before = set(threading.enumerate())
    session = open_session(config(free_endpoint()))
    called = threading.Event()

    def slow(_: Any) -> None:
        called.set()
        time.sleep(0.2)

    session.declare_subscriber("a/b", slow)
    session.put("a/b", b"x")
    session.declare_queryable("a/c", print)
    session.watch_liveliness("a/d", print)
    assert len(set(threading.enumerate()) - before) == 3  # else the test shows nothing
    assert called.wait(10)
    session.close()
    assert set(threading.enumerate()) <= before
    for declare in (session.declare_subscriber, session.declare_queryable, session.watch_liveliness):
        with pytest.raises(SinkError, match="the session is closed"):
            declare("a/b", print)
    session.close()
    assert set(threading.enumerate()) <= before


def test_the_default_listens_on_loopback_only_and_does_not_scout() -> None:
    assert ZenohConfig(vehicle="a").listens() == ("tcp/127.0.0.1:7447",)
    endpoint = free_endpoint()
    session = open_session(config(endpoint))
    try:
        port = int(endpoint.rsplit(":", 1)[1])
        udp, tcp = Path("/proc/net/udp").read_text(), Path("/proc/net/tcp").read_text()
        assert f"0100007F:{port:04X}" in tcp
        assert f":{7446:04X} " not in udp  # Zenoh's scouting port
    finally:
        session.close()


def test_a_port_in_use_is_one_clear_line() -> None:
    endpoint = free_endpoint()
    holds_the_port = open_session(config(endpoint))
    try:
        with pytest.raises(SinkError, match="is in use; stop the other router") as caught:
            open_session(config(endpoint))
    finally:
        holds_the_port.close()
    assert endpoint in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_client_without_a_router_is_a_sink_error() -> None:
    endpoint = free_endpoint()
    with pytest.raises(SinkError, match="no router answers at tcp/127"):
        open_session(config(endpoint, mode="client", connect=(endpoint,)))


@pytest.mark.parametrize("vehicle", ["", "a b", "a/b", "*", "$x", "a?", "#", "é", "a\n"])
def test_a_vehicle_that_cannot_be_part_of_a_key_is_refused(vehicle: str) -> None:
    with pytest.raises(ValueError, match="cannot be part of a key"):
        ZenohConfig(vehicle=vehicle)


def test_a_config_file_takes_precedence_and_our_defaults_fill_it_up(tmp_path: Path) -> None:
    theirs, ours = free_endpoint(), free_endpoint()
    file = tmp_path / "zenoh.json5"
    file.write_text(f'{{mode: "router", listen: {{endpoints: ["{theirs}"]}}}}')
    session = open_session(config(ours, config_file=str(file)))
    try:
        with pytest.raises(SinkError, match="in use"):
            open_session(config(theirs))
        open_session(config(ours)).close()  # free: the file's endpoint was taken instead
    finally:
        session.close()
    file.write_text("{}")
    session = open_session(config(ours, config_file=str(file)))
    try:
        with pytest.raises(SinkError, match="in use"):
            open_session(config(ours))
    finally:
        session.close()


@pytest.mark.parametrize(("content", "message"), [(None, "does not exist"), ("{mode: ", "cannot be read")])
def test_a_config_file_that_is_none_is_a_sink_error(tmp_path: Path, content: str | None, message: str) -> None:
    file = tmp_path / "zenoh.json5"
    if content is not None:
        file.write_text(content)
    with pytest.raises(SinkError, match=message):
        open_session(config(free_endpoint(), config_file=str(file)))

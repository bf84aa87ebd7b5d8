"""Where Zenoh listens: with TLS on, no plain listener stays open unless it is asked for."""

import json
from pathlib import Path

import pytest

from onboard.sinks import SinkError
from onboard.sinks.zenoh_session import DEFAULT_LISTEN, ZenohConfig, _zenoh_config, open_session

TLS = "tls/router.example:7447"


def listens(config: ZenohConfig) -> list[str]:
    found: list[str] = json.loads(_zenoh_config(config).get_json("listen/endpoints"))
    return found


def test_by_default_the_loopback_interface_is_listened_on() -> None:
    assert listens(ZenohConfig()) == list(DEFAULT_LISTEN)
    assert listens(ZenohConfig(mode="peer", connect=("tcp/192.168.1.20:7447",))) == list(DEFAULT_LISTEN)


@pytest.mark.parametrize("endpoint", [TLS, "quic/router.example:7447", "TLS/router.example:7447"])
def test_with_tls_there_is_no_plain_listener(endpoint: str) -> None:
    assert listens(ZenohConfig(mode="peer", connect=(endpoint,))) == []


def test_a_listener_that_is_asked_for_stays() -> None:
    wanted = ("tcp/127.0.0.1:7448",)
    assert listens(ZenohConfig(mode="peer", connect=(TLS,), listen=wanted)) == list(wanted)
    assert listens(ZenohConfig(mode="peer", connect=(TLS,), listen=DEFAULT_LISTEN)) == list(DEFAULT_LISTEN)


def test_a_file_with_tls_closes_the_plain_listener(tmp_path: Path) -> None:
    path = tmp_path / "zenoh.json5"
    path.write_text(f'{{mode: "peer", connect: {{endpoints: ["{TLS}"]}}}}')
    assert listens(ZenohConfig(config_file=str(path))) == []
    path.write_text('{listen: {endpoints: ["tls/0.0.0.0:7447"]}}')
    assert listens(ZenohConfig(config_file=str(path))) == ["tls/0.0.0.0:7447"]


def test_an_endpoint_that_zenoh_rejects_is_named() -> None:
    with pytest.raises(SinkError, match=r'zenoh: listen/endpoints cannot be \["nonsense"\]; an endpoint is like'):
        open_session(ZenohConfig(listen=("nonsense",)))

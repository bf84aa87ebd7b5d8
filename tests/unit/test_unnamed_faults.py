"""Without the airframe's constants some faults have no name, and whoever starts the daemon is told."""

import asyncio
from contextlib import suppress
from typing import Any

import pytest

from onboard.config import Config, parse_config
from onboard.daemon import Daemon

OWN: dict[str, tuple[dict[str, Any], bool]] = {
    "none": ({}, False),
    "unknown": ({"estimator": {"own_state": {}}}, True),
    "known": ({"estimator": {"own_state": {"airframe": "x500"}}}, False),
}


async def first_lines(config: Config) -> list[str]:
    """What the daemon says until it flies."""
    lines: list[str] = []

    def report(line: str) -> None:
        lines.append(line)
        if line.startswith("link "):
            asyncio.get_running_loop().call_later(0.1, flying.cancel)

    flying = asyncio.ensure_future(Daemon(config, report=report).run(()))
    with suppress(asyncio.CancelledError):
        await flying
    return lines


@pytest.mark.parametrize("name", OWN)
def test_an_unknown_airframe_is_said_at_the_start(name: str) -> None:
    sections, is_said = OWN[name]
    links = [{"name": "udp", "url": "udpin:127.0.0.1:0"}]
    config = parse_config({"link": links, "zenoh": {"enabled": False}, **sections})
    lines = asyncio.run(first_lines(config))
    assert any(line.startswith("link udp") for line in lines)
    assert [line for line in lines if "airframe unknown" in line] == [config.unnamed_faults()] * is_said
    assert ("onboard calibrate" in config.unnamed_faults()) is is_said

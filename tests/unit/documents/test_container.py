"""Containerfile and compose.yaml: what they copy and call exists, they keep what they promise, and the image is
built where there is a builder."""

import json
import re
import shlex
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

from onboard.commands import cli
from onboard.config import load_config
from simlink import cli as simlink_cli
from simlink.scenarios.scenario import scenario_names
from tests.support.programs import ROOT

TEXT = (ROOT / "Containerfile").read_text(encoding="utf-8")
LINES = [line for line in TEXT.replace("\\\n", " ").splitlines() if line and not line.startswith("#")]
COMPOSE: dict[str, Any] = yaml.safe_load((ROOT / "compose.yaml").read_text(encoding="utf-8"))
SERVICES: dict[str, dict[str, Any]] = COMPOSE["services"]
PARSERS = {"onboard": cli.parser, "simlink": simlink_cli.parser}
NETWORK = ("registry", "lookup", "network", "timeout", "connection", "dial tcp", "resolve")


def instructions(name: str, stage: str | None = None) -> list[str]:
    """The arguments of an instruction, of one stage or of all."""
    found, current = [], None
    for line in LINES:
        if line.startswith("FROM"):
            current = line.rpartition(" AS ")[2]
        if line.startswith(f"{name} ") and stage in (None, current):
            found.append(line.removeprefix(f"{name} ").strip())
    return found


def check_call(words: list[str]) -> None:
    """The program is one of ours, and takes these arguments."""
    program, *arguments = words
    PARSERS[program]().parse_args(arguments)


def test_all_that_is_copied_exists_and_is_not_ignored() -> None:
    ignored = (ROOT / ".containerignore").read_text(encoding="utf-8").split()
    sources = [
        word for line in instructions("COPY", "build") for word in shlex.split(line)[:-1] if "--from" not in word
    ]
    assert sources
    for source in sources:
        assert (ROOT / source).exists(), source
        assert f"!{source}" in ignored
    assert {source.strip("./") for source in sources} >= {"onboard", "simlink", "configs", "examples"}
    assert (ROOT / ".dockerignore").read_bytes() == (ROOT / ".containerignore").read_bytes()


def test_stages_that_are_built_on_and_copied_from_are_there() -> None:
    stages: list[str] = []
    for line in instructions("FROM"):
        base, _, name = line.partition(" AS ")
        assert base in stages or base.startswith("docker.io/library/python:"), base
        stages.append(name)
    taken = {line.split()[0].removeprefix("--from=") for line in instructions("COPY") if "--from" in line}
    taken |= {stage for line in instructions("RUN") for stage in re.findall(r"--mount=\S*from=(\w+)", line)}
    assert taken == {"build"}
    assert taken <= {*stages}
    assert {service["build"]["target"] for service in SERVICES.values() if "build" in service} <= {*stages}


def test_its_commands_exist() -> None:
    calls = [json.loads(line) for line in instructions("RUN") + instructions("CMD") if line.startswith("[")]
    calls += [json.loads(line.partition(" CMD ")[2]) for line in instructions("HEALTHCHECK")]
    assert len(calls) == 3
    for call in calls:
        check_call(call[1:] if call[0] == "wingline" else call)
    assert instructions("ENTRYPOINT") == ['["wingline"]']
    assert "/usr/local/bin/wingline" in TEXT


def test_it_flies_compiled_by_a_user_without_rights() -> None:
    user = instructions("USER", "flight")
    assert user == ["10001:10001"]
    assert instructions("USER", "desk")[-1] == user[0]
    assert "python -m onboard.compiled all" in TEXT[: TEXT.index("FROM", TEXT.index("AS build"))]
    assert [json.loads(line) for line in instructions("VOLUME")] == [["/var/lib/onboard"]]
    assert not instructions("EXPOSE")


@pytest.mark.parametrize("name", SERVICES)
def test_a_service_of_compose_calls_what_there_is_and_has_no_rights(name: str) -> None:
    service = SERVICES[name]
    check_call(service["command"])
    assert service["read_only"] is True
    assert service["cap_drop"] == ["ALL"]
    assert "ports" not in service
    assert {*service.get("depends_on", ())} <= {*SERVICES}
    built = {s["image"] for s in SERVICES.values() if "build" in s}
    assert service["image"] in built


def test_compose_flies_a_scenario_on_its_configuration() -> None:
    (mounted,) = SERVICES["onboard"]["volumes"]
    here, there, mode = mounted.split(":")
    config = Path(SERVICES["onboard"]["command"][-1])
    assert mode == "ro"
    assert config.parent == Path(there)
    loaded = load_config(ROOT / here / config.name)
    assert loaded.zenoh.listens() == ("tcp/127.0.0.1:7447",)  # where `view` looks by itself
    assert SERVICES["simlink"]["command"][2] in scenario_names()


def builder() -> str | None:
    """A program that builds images, and can here."""
    for name in ("podman", "docker", "buildah"):
        if shutil.which(name) is not None:
            asked = subprocess.run([name, "info"], capture_output=True, check=False, timeout=60)
            if asked.returncode == 0:
                return name
    return None


@pytest.mark.slow
def test_the_image_is_built_and_starts_on_a_file_system_that_is_only_read() -> None:
    program = builder()
    if program is None:
        pytest.skip("no podman, docker or buildah that can build here")
    build = [program, "build", "--target", "flight", "-t", "wingline:tested", "-f", "Containerfile", "."]
    built = subprocess.run(build, cwd=ROOT, capture_output=True, text=True, check=False, timeout=850)
    if built.returncode and any(word in built.stderr.lower() for word in NETWORK):
        pytest.skip(f"its base cannot be fetched here: {built.stderr.splitlines()[-1]}")
    assert built.returncode == 0, built.stderr[-2000:]
    if program == "buildah":
        return
    call = [program, "run", "--rm", "--read-only", "--network", "none", "wingline:tested", "onboard", "check"]
    ran = subprocess.run([*call, "--wait", "1"], capture_output=True, text=True, check=False, timeout=120)
    assert ran.stdout.startswith("ok   filters"), ran.stdout + ran.stderr
    assert ran.returncode == 1  # nothing is connected

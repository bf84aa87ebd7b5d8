"""A Zenoh file's explicit settings count, whatever their value."""

import json
from pathlib import Path

import pytest

from onboard.sinks.zenoh_session import ZenohConfig, _trust, _zenoh_config
from onboard.sinks.zenoh_stated import stated_in

EXPLICIT = {
    "transport/shared_memory/enabled": True,
    "transport/link/rx/max_message_size": 1 << 30,
    "transport/link/tx/queue/size/data": 2,
    "scouting/multicast/enabled": True,
    "listen/endpoints": {"router": ["tcp/[::]:7447"], "peer": ["tcp/[::]:0"]},
    "connect/retry": {"period_init_ms": 1000, "period_max_ms": 4000, "period_increase_factor": 2.0},
    "mode": "peer",
}


@pytest.mark.parametrize("key", EXPLICIT)
def test_a_setting_that_equals_zenoh_s_default_counts(tmp_path: Path, key: str) -> None:
    tree: object = EXPLICIT[key]
    for part in reversed(key.split("/")):
        tree = {part: tree}
    for name, text in (("z.json5", json.dumps(tree)), ("z.yaml", json.dumps(tree, indent=1))):
        path = tmp_path / name
        path.write_text(text)
        result = _zenoh_config(ZenohConfig(config_file=str(path)))
        assert json.loads(result.get_json(key)) == EXPLICIT[key]
        untouched = next(k for k in EXPLICIT if not k.startswith((key, "mode")))
        assert json.loads(result.get_json(untouched)) != EXPLICIT[untouched]


def test_what_a_file_leaves_out_of_a_group_keeps_our_default(tmp_path: Path) -> None:
    path = tmp_path / "z.json5"
    for endpoint, most_ms in (("tcp/127.0.0.1:7447", 500), ("tcp/192.168.1.2:7447", 2000)):
        for in_file, connect in ((f"endpoints: ['{endpoint}'], ", ()), ("", (endpoint,))):
            path.write_text(f"{{connect: {{{in_file}retry: {{period_init_ms: 1000}}}}}}")
            config = _zenoh_config(ZenohConfig(config_file=str(path), connect=connect))
            found = json.loads(config.get_json("connect/retry"))
            assert (found["period_init_ms"], found["period_max_ms"]) == (1000, most_ms)


def test_every_spelling_of_json5_is_read(tmp_path: Path) -> None:
    path = tmp_path / "z.json5"
    path.write_text(
        """// {"mode": 1}
        { 'mode': "peer", /* scouting: {} */ "listen": {endpoints: ["tcp/a:1", 'tls/b:2#{c}'],},
          access_control: {rules: [{id: "x", flows: ["ingress"]}]},
          transport: {unicast: {max_sessions: 0x10}}, }"""
    )
    assert stated_in(str(path)) == {
        "mode",
        "listen",
        "listen/endpoints",
        "access_control",
        "access_control/rules",
        "transport",
        "transport/unicast",
        "transport/unicast/max_sessions",
    }


@pytest.mark.parametrize(
    ("stated", "checks"),
    [({}, True), ({"verify_name_on_connect": True}, True), ({"verify_name_on_connect": False}, False)],
)
def test_a_router_s_name_is_checked_unless_a_file_says_otherwise(
    tmp_path: Path, stated: dict[str, bool], checks: bool
) -> None:
    path = tmp_path / "z.json5"
    path.write_text(json.dumps({"transport": {"link": {"tls": stated}}}))
    assert _trust(_zenoh_config(ZenohConfig(config_file=str(path)))).checks_name is checks

"""`onboard run` with `simlink run quadrotor`: our own state over Zenoh and as ODOMETRY."""

import math
import socket
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.messages import Health, NavState, Truth
from onboard.view.client import Client
from simlink.scenarios.describe import daemon_config
from simlink.scenarios.scenario import load_scenario
from tests.support.programs import free_ports, started, until

TOLERANCE_NS = 25_000_000
UDP, TCP = socket.SOCK_DGRAM, socket.SOCK_STREAM


def test_a_weak_motor_is_named_over_zenoh_and_mavlink_seed_2(tmp_path: Path) -> None:
    autopilot, ground, zenoh = free_ports(UDP, UDP, TCP)
    endpoint = f"tcp/127.0.0.1:{zenoh}"
    config, scenario = tmp_path / "q.toml", tmp_path / "early.toml"
    scenario.write_text('extends = "quadrotor-motor"\n[quadrotor.fault]\nat = 7.0\n', encoding="utf-8")
    config.write_text(daemon_config(load_scenario(str(scenario))), encoding="utf-8")
    links = f"link=[{{name='autopilot', url='udpin:127.0.0.1:{autopilot}'}}, "
    links += f"{{name='ground', url='udpout:127.0.0.1:{ground}', autopilot=false}}]"
    settings = [links, f"zenoh.listen=['{endpoint}']", "odometry.link='ground'"]
    receiver = socket.socket(socket.AF_INET, UDP)
    receiver.bind(("127.0.0.1", ground))
    receiver.settimeout(0.05)
    command = ("onboard", "run", config, *(a for s in settings for a in ("--set", s)))
    simulator = ("simlink", "run", str(scenario), "--seed", "2", "--camera", "none", "--tcp", "none")
    simulator += ("--mavlink", f"udpout:127.0.0.1:{autopilot}", "--zenoh", endpoint, "--wait", "300")
    records: list[Any] = []
    odometry: list[Any] = []
    parser = dialect.MAVLink(None)
    with receiver, started(tmp_path / "daemon.log", *command) as daemon:
        daemon.wait_for("link ground")
        client: Client = until(lambda: Client(endpoint, "1"), "the daemon's Zenoh")
        try:
            # a computer that is short of time needs longer to name it
            with started(tmp_path / "simlink.log", *simulator, "--duration", "60"):

                def named() -> bool:
                    collect(client, receiver, parser, records, odometry)
                    flown = [r.t_ns for r in records if isinstance(r, Truth)]
                    is_named = any(r.faults for r in records if isinstance(r, Health))
                    return is_named and flown[-1] - flown[0] > 10 * 10**9

                until(named, "the fault in the health")
        finally:
            client.close()
        assert daemon.end() == 0
    states = [r for r in records if isinstance(r, NavState) and r.valid]
    truths = [r for r in records if isinstance(r, Truth)]
    assert len(states) > 30
    settled = states[0].t_ns + 4 * 10**9
    nearest = [(min(states, key=lambda s: abs(s.t_ns - t.t_ns)), t) for t in truths if t.t_ns > settled]
    pairs = [(s, t) for s, t in nearest if abs(s.t_ns - t.t_ns) < TOLERANCE_NS]
    assert len(pairs) > 30
    # a computer that is short of time leaves out what has waited: the state is then as uncertain as it says
    carried = [link for r in records if isinstance(r, Health) for link in r.links.values()]
    starved = any(link.skipped or link.dropped for link in carried)
    assert starved or max(math.dist(s.mean[3:6], t.v_F_n) for s, t in pairs) < 0.32
    for s, t in pairs:
        sigma = math.sqrt(sum(s.covariance[k][k] for k in range(3, 6)))
        assert math.dist(s.mean[3:6], t.v_F_n) < max(0.32, 4.0 * sigma), (starved, s.t_ns)
    assert {f.part for r in records if isinstance(r, Health) for f in r.faults} == {"motor 1"}
    # of one time there may be two states: a fix that has come since makes another
    by_time = {s.t_ns // 1000: s for s in states}
    same = [m for m in odometry if m.time_usec in by_time]
    assert len(same) > 0.5 * len(odometry) > 15  # how many come in that time is the computer's doing
    apart = sorted(math.dist((m.x, m.y, m.z), by_time[m.time_usec].mean[:3]) for m in same)
    assert apart[len(apart) // 2] < 1e-3
    assert {(m.frame_id, m.child_frame_id, m.reset_counter) for m in same} == {(1, 12, 0)}


def collect(client: Client, receiver: socket.socket, parser: Any, records: list[Any], odometry: list[Any]) -> None:
    """Receive what has arrived over Zenoh and MAVLink."""
    for _ in range(200):
        received = client.take(0.0)
        if received is None:
            break
        records.append(received.record)
    try:
        for _ in range(50):
            messages = parser.parse_buffer(receiver.recv(65535)) or ()
            odometry += [m for m in messages if m.get_type() == "ODOMETRY"]
    except TimeoutError:
        return

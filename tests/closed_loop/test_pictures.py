"""From pixels to estimates: the example detectors on drawn pictures, through the default pipeline."""

import json
import tomllib

import pytest
from msgspec.structs import replace

from onboard.config import parse_config
from onboard.messages import Datagram, Encoding, Estimate, Truth
from onboard.pipeline import Pipeline
from onboard.scoring.leader import LeaderScore, score_leader
from onboard.scoring.reference import reference_from_records
from simlink.scenarios.describe import daemon_config
from simlink.scenarios.scenario import load_scenario
from simlink.sensors.pictures import Painter, picture_detector
from simlink.simulation import EPOCH_NS, boot_time_ns, datagrams, ticks
from simlink.world.drawn import draw_scenario
from simlink.world.truth import true_size
from studies.closed_loop.flight import fly
from tests.unit.simlink.test_pictures import example

DETECTION_LATENCY_NS = 60_000_000  # from exposure to arrival


def flown(name: str, detector: str, seed: int, seconds: float) -> LeaderScore:
    """Return the score of a flight of scenario `name` on a detector's output alone."""
    scenario, find = load_scenario(name), example(detector).find
    flight = draw_scenario(scenario, seed)
    painter = Painter(flight.camera, true_size(flight, seed), seed)
    timed, truths = [], []
    for item in datagrams(scenario, seed, seconds, "none"):
        if isinstance(item, Datagram):
            timed.append((item.t_recv_ns, item))
        elif isinstance(item, Truth):
            truths.append(item)
    boot_ns = boot_time_ns(scenario)
    for tick in ticks(scenario, seed, boot_ns):
        if tick.t_ns > boot_ns + seconds * 1e9:
            break
        found = None if tick.truth is None else find(painter.paint(tick.state))
        if found is not None:
            points = {n: {"u_px": float(u), "v_px": float(v), "sigma_px": s} for n, (u, v, s) in found.items()}
            sent = {"t_ns": tick.t_ns, "clock": "boot", "detections": [{"points": points, "target": "leader"}]}
            at, data = EPOCH_NS + tick.t_ns + DETECTION_LATENCY_NS, json.dumps(sent).encode()
            timed.append((at, Datagram(channel="k", encoding=Encoding.DETECTIONS, t_recv_ns=at, data=data)))
    pipeline, estimates = Pipeline(parse_config(tomllib.loads(daemon_config(scenario)))), []
    for _, datagram in sorted(timed, key=lambda pair: pair[0]):
        estimates += [o for o in pipeline.feed(datagram) if isinstance(o, Estimate) and o.name == "leader"]
    return score_leader(estimates, reference_from_records(truths))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "detector"), [("pictures", "contour"), ("pictures-tag", "tag")])
def test_the_truth_is_in_the_ellipsoid_on_pixels_alone_seeds_1_to_4(name: str, detector: str) -> None:
    scores = [flown(name, detector, seed, 40.0) for seed in range(1, 5)]
    inside = [s.inside_95_percent for s in scores if s.inside_95_percent is not None]
    assert len(inside) == 4
    assert sum(inside) / 4 >= 92.0
    assert all(s.valid_percent is not None and s.valid_percent > 90.0 for s in scores)


@pytest.mark.slow
def test_it_follows_on_what_the_contour_finds_seed_1() -> None:
    """30 s: it follows from 10 s on."""
    scenario = load_scenario("pictures-follow")
    painter = Painter(draw_scenario(scenario, 1).camera, true_size(scenario, 1), 1)
    flight = fly(scenario, 1, 30.0, detect=picture_detector(example("contour").find, painter))
    k = flight.t > 15.0
    assert flight.valid[k].all()
    assert flight.following[k].all()
    assert flight.slot_error[k].max() < 2.5  # 1.3; of 25


def test_it_stops_where_no_detector_finds_a_leader_seed_1() -> None:
    flight = fly(load_scenario("pictures-follow"), 1, 22.0, detect=lambda _state, _t_ns: None)
    assert not flight.valid.any()
    assert flight.speed[-1] < 0.5


def test_a_painted_scenario_loads_with_its_detectors_seed_1() -> None:
    for name, kind in (("pictures", "aircraft"), ("pictures-tag", "tag")):
        scenario = load_scenario(name)
        assert scenario.camera.pictures == kind
        assert replace(scenario.camera, pictures="none", rate=25.0) == load_scenario("formation").camera

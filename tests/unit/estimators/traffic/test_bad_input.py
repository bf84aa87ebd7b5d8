"""What the tracker rejects, and the reasons: reports, floods, settings."""

import math
import subprocess
import sys

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.estimators.traffic.config import Config
from onboard.estimators.traffic.estimator import Estimator
from onboard.messages import RadarScan
from onboard.units import NS_PER_S
from tests.support.traffic import CAMERA, NAME, NORTH, R0, V0, Sky, fly_with_reports, mean


@pytest.mark.parametrize(
    ("changes", "verdict"),
    [
        ({"tslc": 6.0}, "stale"),
        ({"lat_deg": None}, "no_position"),
        ({"lon_deg": None}, "no_position"),
        ({"altitude": None}, "no_position"),
        ({"lat_deg": 91.0}, "implausible"),
        ({"lon_deg": 181.0}, "implausible"),
        ({"lat_deg": math.nan}, "implausible"),
        ({"altitude": 40_000.0}, "implausible"),
        ({"altitude": math.inf}, "implausible"),
        ({"ground_speed": 400.0}, "implausible"),
        ({"climb": math.nan}, "implausible"),
        ({"icao": 0}, "implausible"),
        ({"icao": 0x1000000}, "implausible"),
        ({"icao": 0xABCDEF}, "ourselves"),
    ],
    ids=str,
)
def test_a_report_that_cannot_be_used_is_counted_by_its_reason(changes: dict[str, object], verdict: str) -> None:
    sky = Sky(own_icao="abCDef")
    fly_with_reports(sky, 3, **changes)
    assert sky.newest == {}
    assert sky.verdicts == {verdict: 3}


def test_without_our_own_position_nothing_is_tracked() -> None:
    sky = Sky()
    fresh = Estimator(Config(), CAMERA)
    fresh.observe(sky.adsb(R0, V0), sky.ownship)
    t_ns = round(sky.t * NS_PER_S)
    fresh.observe(RadarScan(t_ns=t_ns, t_recv_ns=0, radar="x", frame="ned", detections=()), sky.ownship)
    assert dict(fresh.verdicts) == {"no_pose": 1}
    assert fresh.tick(sky.ownship) == []


def test_a_report_later_than_the_horizon_is_not_fused() -> None:
    sky = Sky()
    fly_with_reports(sky, 15)
    for late_s, verdicts in ((7.5, {}), (8.5, {"too_old": 1})):
        report = sky.adsb(R0 + V0 * (sky.t - late_s), V0, icao=0xABC000 + round(late_s))
        sky.receive(replace(report, t_ns=round((sky.t - late_s) * NS_PER_S)))
        sky.fly(0.2)
        assert {k: n for k, n in sky.verdicts.items() if k not in {"fused", "initialising"}} == verdicts


def test_a_report_of_uncertain_age_is_uncertain_along_its_velocity() -> None:
    covariances = []
    for sigma in (0.0, 2.0):
        sky = Sky(adsb_latency_sigma_s=sigma)
        fly_with_reports(sky, 3)
        (track,) = sky.estimator._tracker.tracks
        assert track.last_report is not None
        covariances.append(track.last_report.R[:3, :3])
    # in our frame, which is turned by two kilometres of the Earth
    np.testing.assert_allclose(covariances[1] - covariances[0], 4.0 * np.outer(V0, V0), atol=3.0)


def test_a_repeated_report_is_not_fused() -> None:
    sky = Sky()
    fly_with_reports(sky, 5)
    last = sky.adsb(R0 + V0 * sky.t, V0)
    sky.receive(last)
    sky.fly(1.0)
    before = sky.newest[NAME].age
    for k in (1, 2):
        sky.receive(replace(last, t_ns=round(sky.t * NS_PER_S), tslc=float(k)))
        sky.fly(1.0)
    assert sky.verdicts["duplicate"] == 2
    age = sky.newest[NAME].age
    assert before is not None
    assert age is not None
    assert age > before + 1.9


def test_a_spoofed_jump_does_not_move_the_track() -> None:
    sky = Sky()
    fly_with_reports(sky, 8)
    for jump in (5000.0, -8000.0):
        sky.receive(sky.adsb(R0 + V0 * sky.t + [jump, 0, 0], V0))
        sky.fly(1.0)
        np.testing.assert_allclose(mean(sky.newest[NAME])[:3], R0 + V0 * sky.t, atol=3.0)
    assert sky.verdicts["implausible"] == 2
    fly_with_reports(sky, 3)
    assert set(sky.newest) == {NAME}
    assert sky.newest[NAME].reset_count == 0


def test_the_number_of_tracks_is_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Config, "max_tracks", 2)
    sky = Sky()
    for k in range(5):
        sky.receive(sky.adsb(R0 + 1000.0 * k * NORTH, V0, icao=k + 1))
    sky.fly(0.2)
    assert len(sky.newest) == 2
    assert sky.verdicts == {"initialising": 2, "full": 3}


def test_reading_a_configuration_loads_no_numerics() -> None:
    code = "import onboard.estimators.traffic.config, sys; print({'numpy', 'numba', 'scipy'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"

"""One view of several vehicles: each record goes to its vehicle's recording."""

from pathlib import Path

import pytest
from msgspec.structs import replace

from onboard.geometry.camera import make_camera
from onboard.messages import Estimate, OwnPose
from onboard.view import words
from onboard.view.fleet import Views
from onboard.view.view import View
from tests.support.view_flight import flight, health_of
from tests.unit.commands.test_status import ADVICE

CAMERA = make_camera(f_px=500.0, width_px=640.0, height_px=480.0)
ZERO = (0.0, 0.0, 0.0)


def pose(t_ns: int) -> OwnPose:
    return OwnPose(t_ns=t_ns, q_nb=(1.0, 0.0, 0.0, 0.0), r_OF_n=ZERO, v_F_n=ZERO, a_F_n=ZERO)


def test_each_vehicle_has_a_recording_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[tuple[View, int]] = []
    monkeypatch.setattr(View, "show", lambda view, record: shown.append((view, record.t_ns)))
    with Views(camera=CAMERA, rrd=tmp_path / "fleet.rrd", spawn=False, apart=True) as views:
        for vehicle, t_ns in (("uav-1", 1), ("uav-2", 2), ("uav-1", 3)):
            views.show(vehicle, pose(t_ns))
        assert not views.is_closed_by_user()
    (one, _), (two, _), _ = shown
    assert one is not two
    assert shown == [(one, 1), (two, 2), (one, 3)]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["fleet-uav-1.rrd", "fleet-uav-2.rrd"]


def test_further_vehicles_share_the_first_ones_server() -> None:
    with (
        View(camera=CAMERA, grpc_port=0, name="uav-1") as first,
        View(camera=CAMERA, server=first.url, name="uav-2") as second,
    ):
        assert second.url == first.url
        assert second.viewer is None
        second.show(pose(1))


def test_the_table_of_a_fleet_has_what_each_knows_and_what_is_wrong() -> None:
    estimate = next(r for r in flight(4.0) if isinstance(r, Estimate) and r.mean is not None)
    bad = replace(health_of(10**9), advice=(ADVICE,))
    table = words.fleet(
        {"uav-2": words.VehicleRecords(health=bad), "uav-1": words.VehicleRecords(estimate, None, health_of(1))}
    )
    first, second = table.splitlines()[2:]
    assert first.startswith("| uav-1 |")
    assert " m | - | - |" in first
    assert second == "| uav-2 | - | - | camera front: no images |"

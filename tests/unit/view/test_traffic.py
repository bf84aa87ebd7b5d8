"""Traffic in the view: the map's arithmetic, the table's order, and that Rerun takes it."""

from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.geometry.camera import make_camera
from onboard.messages import Estimate, Lifecycle, ThreatLevel
from onboard.view import traffic
from onboard.view.columns import Columns
from onboard.view.memory import Memory
from onboard.view.view import View
from tests.support.vehicle_records import APPROACH, INTRUDER, TRAFFIC

S = 1_000_000_000
P = tuple(map(tuple, np.diag([100.0, 400.0, 25.0, 1.0, 1.0, 1.0]).tolist()))


def aircraft(target: str, r: tuple[float, float, float], distance: float, threat: ThreatLevel) -> Estimate:
    approach = replace(APPROACH, distance=distance, threat=threat)
    mean = (*r, 10.0, 0.0, 0.0)
    who = replace(INTRUDER, callsign="", approach=approach)
    return replace(TRAFFIC, target=target, mean=mean, covariance=P, intruder=who)


NEAR = aircraft("icao/000001", (300.0, -400.0, -50.0), 40.0, ThreatLevel.HIGH)
FAR = aircraft("radar/2", (0.0, 2000.0, 30.0), 900.0, ThreatLevel.NONE)


def test_north_is_up_and_east_is_right_on_a_screen_whose_y_points_down() -> None:
    np.testing.assert_allclose(traffic.on_map(np.array([[1.0, 0.0, 9.0], [0.0, 1.0, 9.0]])), [[0, -1], [1, 0]])


def test_the_ellipse_is_three_sigma_of_east_and_north() -> None:
    outline = traffic.ellipse(NEAR)
    assert np.abs(outline).max(axis=0) == pytest.approx([60.0, 30.0])


def test_the_table_begins_with_the_nearest_approach() -> None:
    rows = traffic.table([FAR, NEAR]).splitlines()[2:]
    assert [row.split("|")[1].strip() for row in rows] == ["**icao/000001**", "radar/2"]
    assert "502 m | 40 ±5 m | 12 s" in rows[0]


def test_a_track_without_a_mean_is_drawn_no_more() -> None:
    memory, columns = Memory(), Columns()
    traffic.draw_traffic(columns, memory, NEAR)
    traffic.draw_traffic(columns, memory, FAR)
    gone = replace(NEAR, mean=None, covariance=None, intruder=None, valid=False, state=Lifecycle.SEARCHING)
    traffic.draw_traffic(columns, memory, gone)
    assert set(memory.traffic) == {"radar/2"}
    traffic.draw_traffic(columns, memory, gone)  # twice, as after a lost record


def test_rerun_takes_many_few_and_no_aircraft(tmp_path: Path) -> None:
    camera, path = make_camera(f_px=500.0, width_px=640.0, height_px=480.0), tmp_path / "t.rrd"
    with View(camera=camera, rrd=path) as view:
        for k in range(12):
            view.show(replace(NEAR, t_ns=(100 + k) * S))
            if k < 6:
                view.show(replace(FAR, t_ns=(100 + k) * S + 1))
        view.show(replace(NEAR, t_ns=113 * S, mean=None, covariance=None, intruder=None))
    assert path.stat().st_size > 5000

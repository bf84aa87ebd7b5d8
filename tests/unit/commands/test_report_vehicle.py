"""What a report shows of the vehicle itself: battery, motors, vibration, GPS, modes and messages, and a map."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from onboard.analysis.flights.replay import replay
from onboard.analysis.report.page import FlightReport, _shorten, html
from onboard.analysis.report.vehicle import MAX_EVENT_ROWS, MAX_PARAMETER_ROWS, VehicleSeries, mode_name
from onboard.analysis.report.vehicle_figures import vehicle_figures
from onboard.commands.report import _parameters
from onboard.messages import ActuatorOutputs, Battery, GpsFix, Heartbeat, Imu, Message, ParamValue, StatusText
from tests.support.dataflash import dataflash
from tests.support.streams import Flight, make_config

AT = {"t_ns": 0, "t_recv_ns": 0, "system": 1}


def beat(mode: int, *, armed: bool = False, autopilot: int = 3, kind: int = 2) -> Heartbeat:
    return Heartbeat(**AT, vehicle_type=kind, autopilot=autopilot, armed=armed, status=4, custom_mode=mode)


def fix(kind: int, lat: float, lon: float, **known: Any) -> GpsFix:
    fields = {"satellites": None, "ground_speed": None, "course_rad": None, "h_acc": None, "v_acc": None} | known
    return GpsFix(**AT, fix_type=kind, lat_deg=lat, lon_deg=lon, alt_msl=500.0, **fields)


def heard(*messages: tuple[float, Message]) -> VehicleSeries:
    series = VehicleSeries()
    for t, message in messages:
        series.hear(message, t)
    return series


@pytest.mark.parametrize(
    ("heartbeat", "name"),
    [
        (beat(23), "FOLLOW"),
        (beat(10, kind=1), "AUTO"),
        (beat(15, kind=10), "GUIDED"),
        (beat(19, kind=12), "MANUAL"),
        (beat(250), "250"),
        (beat(8 << 24 | 4 << 16, autopilot=12), "AUTO FOLLOW_TARGET"),
        (beat(3 << 16, autopilot=12), "POSCTL"),
        (beat(7, autopilot=0), "7"),
    ],
)
def test_modes_have_the_names_that_pilots_know(heartbeat: Heartbeat, name: str) -> None:
    assert mode_name(heartbeat) == name


def test_changes_of_mode_arming_and_texts_are_said_once() -> None:
    series = heard(
        *((1.0, beat(5)), (2.0, beat(5)), (3.0, beat(5, armed=True)), (4.0, beat(23, armed=True))),
        (5.0, StatusText(**AT, severity=4, text="Low\x1b[31m battery")),
        (6.0, beat(23)),
    )
    assert series.words == [
        *((1.0, "mode", "LOITER"), (3.0, "armed", ""), (4.0, "mode", "FOLLOW")),
        *((5.0, "warning", series.words[3][2]), (6.0, "disarmed", "")),
    ]
    assert "\x1b" not in series.words[3][2]
    many = heard(*((float(k), StatusText(**AT, severity=6, text=str(k))) for k in range(MAX_EVENT_ROWS + 7)))
    assert (len(many.words), many.left_out) == (MAX_EVENT_ROWS, 7)


def test_vibration_is_what_differs_from_sample_to_sample() -> None:
    """Seed 3: noise of 0.5 m/s^2 on the axis that points right, beside a slow turn."""
    rng = np.random.default_rng(3)
    forces = [(float(np.sin(k / 100)), float(rng.normal(0.0, 0.5)), -9.8) for k in range(2000)]
    series = heard(*((0.01 * k, Imu(**AT, f_b=f, omega_b=(0.0, 0.0, 0.0))) for k, f in enumerate(forces)))
    table = series.vibration.table()
    assert len(table) == 39
    np.testing.assert_allclose(np.sqrt((table[:, 1:] ** 2).mean(axis=0)), [0.005, 0.5, 0.0], atol=0.03)


def test_figures_show_what_was_sent_alone() -> None:
    battery = [(0.2 * k, Battery(**AT, voltage_v=12.6 - 0.01 * k)) for k in range(20)]
    motors = [(0.2 * k, ActuatorOutputs(**AT, pwm_us=(1500, 1600, 0))) for k in range(20)]
    assert vehicle_figures(heard()) == {}
    (title,) = drawn = vehicle_figures(heard(*battery, *motors))
    above, below = drawn[title].axes
    np.testing.assert_allclose(above.lines[0].get_ydata(), [m.voltage_v for _, m in battery])
    assert [line.get_label() for line in below.lines] == ["1", "2"]  # 0: unused


def test_the_map_has_a_scale_and_only_what_is_a_fix() -> None:
    fixes = [fix(1, 0.0, 0.0), *(fix(3, 47.0 + 1e-5 * k, 8.0, satellites=12, h_acc=0.5) for k in range(100))]
    drawn = vehicle_figures(heard(*((0.2 * k, one) for k, one in enumerate(fixes))))
    assert list(drawn) == ["GPS", "Map, north up"]
    (axis,) = drawn["Map, north up"].axes
    track, _, scale = axis.lines
    assert np.asarray(track.get_ydata()).min() == 47.0
    west, east = np.asarray(scale.get_xdata())
    assert scale.get_label() == "50 m"  # of 110 m to the north
    assert (east - west) * 111_195.0 * np.cos(np.radians(47.0)) == pytest.approx(50.0, rel=1e-3)
    assert axis.get_aspect() == pytest.approx(1.0 / np.cos(np.radians(47.0005)), rel=1e-4)
    lost = drawn["GPS"].axes[0].lines[1]
    assert (len(np.asarray(lost.get_xdata())), lost.get_label()) == (1, "no 3-D fix")


def test_an_autopilot_s_own_log_shows_its_vehicle(tmp_path: Path) -> None:
    path, series = tmp_path / "a.bin", VehicleSeries()
    dataflash(Flight(), 3.0, path)
    replay(path, make_config(), hear=series.hear, keep=False)
    assert series.battery.table()[-1, 1] == pytest.approx(12.1, abs=0.01)
    assert series.outputs.table()[-1, 1:5].tolist() == [1500.0, 1501.0, 1502.0, 1503.0]
    assert series.gps.table()[-1, 1:5].tolist() == pytest.approx([4.0, 12.0, 0.5, 0.8])
    assert len(series.vibration.table()) >= 4
    assert series.words[0][1:] == ("mode", "STABILIZE")


def parameter(name: str, value: float, default: float | None = None) -> ParamValue:
    return ParamValue(**AT, extended=False, name=name, value=value, default=default)


def test_parameters_that_somebody_has_set_come_first() -> None:
    series = heard(
        *((1.0, parameter("AHRS_EKF", 3.0, 3.0)), (1.0, parameter("WPNAV_SPEED", 1200.0, 1000.0))),
        *((1.0, parameter("MASK", 15012864.0)), (1.0, parameter("GAIN", 0.135, 0.135000005))),
        *((1.0, parameter("UNSET", float("nan"))), (9.5, parameter("MASK", 3.0))),
        *((9.0, parameter("AHRS_EKF", 3.0)), (9.0, parameter("\x1b[31m", 1.0, 1.0))),
    )
    assert _parameters(series) == [
        ("parameter", "value", "default", "set in flight"),
        ("MASK", "3", "", "at 9.50 s, from 15012864"),
        ("WPNAV_SPEED", "1200", "1000", ""),
        *(("?[31m", "1", "1", ""), ("AHRS_EKF", "3", "3", "")),
        *(("GAIN", "0.135", "0.135", ""), ("UNSET", "nan", "", "")),
    ]


def test_parameters_are_bounded_on_the_page_and_in_the_pdf() -> None:
    many = heard(*((1.0, parameter(f"P{k:05}", 1.0)) for k in range(MAX_PARAMETER_ROWS + 5)))
    table = _parameters(many)
    assert (len(table), table[-1][0]) == (MAX_PARAMETER_ROWS + 2, "and 5 more")
    shown = _shorten(table)
    assert (len(shown), shown[-1][0]) == (157, f"and {len(table) - 156} more, in the page")
    assert _shorten(table[:157]) == table[:157]
    page = html(FlightReport("a", [], [], {}, {}, "", table))
    assert "<details><summary>3001, those" in page
    assert "type=search" in page
    assert "P00000" in page
    assert "type=search" not in html(FlightReport("a", [], [], {}, {}, "", table[:1]))

"""Our own state in the view: estimate, autopilot and truth in the same plots."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from onboard.geometry.camera import Camera
from onboard.geometry.rotations import quaternion_from_euler
from onboard.messages import Fault, FaultKind, OwnPose
from tests.support.vehicle_records import nav_state, truth

pytest.importorskip("rerun")

from onboard.view import layout, own, palette, scene
from onboard.view.columns import HIDDEN
from onboard.view.memory import Memory
from tests.support.view_flight import (
    START_TIME_S,
    Drawn,
    Kept,
    flight,
    record_flight,
    rows_of,
    truth_of,
)


def test_estimate_autopilot_and_truth_share_their_plots() -> None:
    kept, memory = Kept(), Memory()
    q = tuple(quaternion_from_euler(0.1, -0.2, 0.3).tolist())
    pose = OwnPose(t_ns=5 * 10**9, r_OF_n=(0, 0, -7), v_F_n=(1, 2, 3), a_F_n=(0, 0, 0), q_nb=q)
    own.plot_autopilot(kept, memory, pose)
    assert not kept.values  # no estimate of our own yet: nothing to stand beside
    own.plot_state(kept, memory, nav_state())
    own.plot_autopilot(kept, memory, pose)
    own.plot_truth(kept, memory, truth_of(3.0))
    for name in scene.OWN_NAMES:
        for who in ("estimate", "autopilot", "truth"):
            assert f"plots/own/{name}/{who}" in kept.values
            assert f"plots/own/{name}/{who}" in scene.PLOTS
    edge = 3 * math.sqrt(5)
    assert_allclose(kept.values["plots/own/east/estimate"], [5.0, 5.0 + edge, 5.0 - edge])
    assert_allclose(kept.values["plots/own/yaw/estimate"][0], 90.0)
    assert_allclose(kept.values["plots/own/pitch/autopilot"], math.degrees(-0.2))
    assert_allclose(kept.values["plots/own/height/autopilot"], 7.0)
    assert_allclose(kept.values["plots/own/trust"], [0.0, 87.0])


def test_without_a_state_curves_have_gaps() -> None:
    kept, memory = Kept(), Memory()
    own.plot_state(kept, memory, nav_state(mean=None, covariance=None, q_nb=None, quality=-1))
    assert np.isnan(kept.values["plots/own/down/estimate"]).all()


MOTOR = Fault(kind=FaultKind.MOTOR, part="motor 2", t_onset_ns=4 * 10**9, magnitude=0.243, unit="lost")
CROSS = ((0.2, 0.0, 1), (0.0, 0.2, -1), (-0.2, 0.0, 1), (0.0, -0.2, -1))


def test_a_weak_motor_is_red_in_the_headline_and_at_its_rotor() -> None:
    kept, memory = Drawn(), Memory()
    own.show_state(kept, memory, nav_state(5000), CROSS)
    assert kept.values[f"{scene.ROTORS_PATH}/discs"] == ([palette.GREEN] * 4, [f"motor {k}" for k in (1, 2, 3, 4)])
    assert kept.values[f"{scene.WEAK}/1"] is HIDDEN
    assert kept.values["faults"] == palette.NO_FAULT
    assert kept.values[f"{scene.OWN_BANNER}/words"].label.endswith("no fault")
    own.show_state(kept, memory, nav_state(6000, faults=(MOTOR,)), CROSS)
    colours, labels = kept.values[f"{scene.ROTORS_PATH}/discs"]
    assert [colour == palette.RED for colour in colours] == [False, True, False, False]
    assert labels[1] == "motor 2: -24%"
    assert kept.values[f"{scene.WEAK}/1"] is not HIDDEN
    assert kept.values[f"{scene.WEAK}/0"] is HIDDEN
    assert kept.values["faults"] == "motor 2"
    line = kept.values[f"{scene.OWN_BANNER}/words"]
    assert line.colour == palette.RED
    # variances of the velocity 4, 5, 6 and of the attitude 7, 8, 9
    assert line.label == (
        "OWN STATE TRACKING · velocity ± 2.24 m/s · attitude ± 162.1° · MOTOR 2 WEAK: 24% of its thrust lost"
    )


@pytest.mark.parametrize("t_ms", [4998, 4990])  # of a state, and between two
@pytest.mark.parametrize("truth_first", [True, False])
def test_errors_are_those_of_a_truth_at_its_own_time(truth_first: bool, t_ms: int) -> None:
    kept, memory = Drawn(), Memory()
    q = tuple(quaternion_from_euler(0.0, 0.0, math.pi / 2 + 0.1).tolist())
    before, same = truth(4_900_000_000, v_F_n=(9, 9, 9)), truth(t_ms * 1_000_000, v_F_n=(3.5, 5, 6), q_nF=q)
    own.show_state(kept, memory, nav_state(4980), ())
    if truth_first:
        memory.truths.extend([before, same])
        own.show_state(kept, memory, nav_state(5000), ())
    else:
        own.show_state(kept, memory, nav_state(5000), ())
        for one in (before, same):
            own.plot_truth(kept, memory, one)
    assert_allclose(kept.values["plots/own/velocity_error/error"], [0.5, 0.0, 0.0])
    assert_allclose(kept.values["plots/own/attitude_error/error"], [0.0, 0.0, math.degrees(-0.1)], atol=1e-9)
    assert_allclose(kept.values["plots/own/velocity_error/band"], [3 * math.sqrt(6), -3 * math.sqrt(6)])


def test_the_window_is_arranged_for_both_once_our_own_state_comes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[tuple[bool, bool]] = []

    def counted(camera: Camera, shown: layout.Contents = layout.LEADER_ALONE, **others: Any) -> Any:
        made.append((shown.leader, shown.own))
        return layout.blueprint(camera, shown, **others)

    monkeypatch.setattr("onboard.view.view.blueprint", counted)
    records = list(flight(2.0))
    record_flight(tmp_path / "leader.rrd", records)
    assert made[-1] == (True, False)
    states = [nav_state(round(START_TIME_S * 1000) + 20 * k) for k in range(100)]
    record_flight(tmp_path / "both.rrd", [*records, *states])
    assert made[-1] == (True, True)
    rows = rows_of(tmp_path / "both.rrd")
    assert rows["/own_banner/words"] >= 9
    assert rows["/plots/own/velocity_error/error"] >= 40
    assert rows["/rotors/words"] >= 9
    assert "/rotors/discs" not in rows  # of an unknown airframe

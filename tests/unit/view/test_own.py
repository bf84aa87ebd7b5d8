"""Our own state in the view: estimate, autopilot and truth in the same plots."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from onboard.geometry.rotations import quaternion_from_euler
from onboard.messages import Fault, FaultKind, OwnPose
from tests.support.vehicle_records import nav_state

pytest.importorskip("rerun")

from onboard.view import own, scene, words
from onboard.view.memory import Memory
from tests.support.view_flight import health_of, truth_of


class Kept:
    """What was drawn: the newest value by entity."""

    def __init__(self) -> None:
        self.values: dict[str, Any] = {}

    def add(self, _kind: Any, entity: str, _t_ns: int, value: Any) -> None:
        self.values[entity] = np.asarray(value)


def test_estimate_autopilot_and_truth_share_their_plots() -> None:
    kept, memory = Kept(), Memory()
    q = tuple(quaternion_from_euler(0.1, -0.2, 0.3).tolist())
    pose = OwnPose(t_ns=5 * 10**9, r_OF_n=(0, 0, -7), v_F_n=(1, 2, 3), a_F_n=(0, 0, 0), q_nb=q)
    own.plot_autopilot(kept, memory, pose)  # type: ignore[arg-type]
    assert not kept.values  # no estimate of our own yet: nothing to stand beside
    own.plot_state(kept, memory, nav_state())  # type: ignore[arg-type]
    own.plot_autopilot(kept, memory, pose)  # type: ignore[arg-type]
    own.plot_truth(kept, memory, truth_of(3.0))  # type: ignore[arg-type]
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
    own.plot_state(kept, memory, nav_state(mean=None, covariance=None, q_nb=None, quality=-1))  # type: ignore[arg-type]
    assert np.isnan(kept.values["plots/own/down/estimate"]).all()


def test_health_names_what_is_wrong() -> None:
    from msgspec.structs import replace  # noqa: PLC0415 - only here

    fault = Fault(kind=FaultKind.MOTOR, part="motor 1", t_onset_ns=50_100_000_000, magnitude=0.25, unit="lost")
    assert "**MOTOR motor 1** since 50.1 s: 0.25 lost" in words.health(replace(health_of(10**9), faults=(fault,)))

"""A leader whose range the estimate leaves open does not look, nor read, like one at a place."""

from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.arrays import Array
from onboard.messages import Estimate, Mode, OwnPose
from onboard.view import words
from onboard.view.motion import LeaderArrays, leader_state, open_interval
from tests.support.view_flight import NEEDS_RERUN, flight


def estimate_with(sigma_range: float) -> Estimate:
    """An estimate of the flight, 24 m straight north, with this sigma of its range."""
    estimate = next(r for r in flight(3.0) if isinstance(r, Estimate) and r.mean is not None)
    P: Array = np.diag([sigma_range, 0.3, 0.3, *[0.2] * 3, 0.05, 0.1, 0.1]) ** 2
    mean = (24.0, 0.0, 0.0, *(estimate.mean or ())[3:])
    covariance = tuple(tuple(row) for row in P.tolist())
    return replace(estimate, mean=mean, covariance=covariance, reason="images fused; heading not resolved")


def state(estimate: Estimate) -> LeaderArrays:
    found = leader_state(estimate)
    assert found is not None
    return found


def test_the_interval_is_two_sigma_either_side_and_none_where_the_range_is_known() -> None:
    assert open_interval(state(estimate_with(2.3))) is None
    assert open_interval(state(estimate_with(6.0))) == pytest.approx((12.0, 36.0))
    assert open_interval(state(estimate_with(20.0))) == pytest.approx((0.0, 64.0))


def test_words_say_from_where_to_where_and_why() -> None:
    wide, sharp = estimate_with(6.0), estimate_with(1.0)
    for text in (words.headline(wide, state(wide), None), words.status(wide, state(wide), None, None)):
        assert "OPEN: 12 to 36 m" in text
        assert "±" in text  # of the size
        assert "24.0" not in text
    assert words.tag(wide, state(wide)).endswith("OPEN: 12 to 36 m · heading not resolved")
    assert "heading not resolved" in words.status(wide, state(wide), None, None)
    assert words.tag(sharp, state(sharp)).endswith("24.0 ± 1.0 m")


def test_an_open_range_has_two_ends_and_no_aircraft_between() -> None:
    pytest.importorskip("onboard.view.view", reason=NEEDS_RERUN, exc_type=ImportError)
    from onboard.view import scene, space  # noqa: PLC0415
    from onboard.view.columns import HIDDEN, Columns  # noqa: PLC0415
    from onboard.view.memory import Memory  # noqa: PLC0415

    def drawn(sigma: float) -> dict[str, Any]:
        columns, estimate = Columns(), estimate_with(sigma)
        memory = Memory()
        memory.own = next(r for r in flight(3.0) if isinstance(r, OwnPose))
        for _ in range(2):  # a trail needs two places
            memory.drawn_ns.clear()
            space.draw_leader(columns, memory, estimate, state(estimate))
        space.draw_tag(columns, estimate.t_ns, state(estimate), (0, 0, 0), "tag")
        return {entity: rows[-1][1] for (_, entity), rows in columns._rows.items()}

    wide, sharp = drawn(6.0), drawn(1.0)
    near, far = (np.asarray(wide[end].translation) for end in scene.OPEN_ENDS)
    np.testing.assert_allclose([near, far], [[12.0, 0, 0], [36.0, 0, 0]])
    np.testing.assert_allclose(wide[scene.OPEN_RANGE], [near, far])
    assert wide[scene.LEADER_PATH] is HIDDEN
    assert 0.0 < max(np.asarray(HIDDEN.scale)) < 1e-5  # the viewer ignores a scale of zero
    assert np.allclose(wide[scene.TAG][0], [12.0, 0.0, -space.TAG_OFFSET])
    assert scene.TRAILS["estimate"] not in wide
    assert scene.TRAILS["estimate"] in sharp
    assert wide[scene.LEADER_VELOCITY] is HIDDEN
    half_axes = np.sort(np.asarray(wide[f"{scene.UNCERTAINTY}/ellipsoid"]))
    np.testing.assert_allclose(half_axes, [0.9, 0.9, 18.0])  # three sigma
    assert sharp[scene.LEADER_PATH] is not HIDDEN
    assert all(sharp[end] is HIDDEN for end in scene.OPEN_ENDS)
    assert len(sharp[scene.OPEN_RANGE]) == 0


def test_words_say_where_it_may_be() -> None:
    one = Mode(weight=0.7, mean=(12.0, 0.0, 0.0, 0.0, 0.0, 0.0), covariance=((1.0,) * 6,) * 6)
    wide = replace(estimate_with(6.0), modes=(one, replace(one, weight=0.3, mean=(25.0, *one.mean[1:]))))
    assert "| possible ranges | 12 m (70%) or 25 m (30%) |" in words.status(wide, state(wide), None, None)
    single = replace(wide, modes=(one,))
    assert "possible ranges" not in words.status(single, state(single), None, None)

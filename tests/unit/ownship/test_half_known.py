"""What is known of our position is compared, although the rest is not."""

import pytest

from onboard.messages import GlobalPosition
from onboard.ownship import Ownship
from tests.support.streams import MS, S


def climbing(v_down: float, slope: float = -3.0, v_north: float = 8.0) -> str:
    """The doubt after two seconds of GLOBAL_POSITION_INT alone, whose height changes and which has a velocity."""
    ownship = Ownship(max_extrapolation=0.1)
    for k in range(20):
        t_ns = 5 * S + k * 100 * MS
        message = GlobalPosition(
            t_ns=t_ns,
            t_recv_ns=t_ns,
            lat_deg=47.0,
            lon_deg=8.0,
            alt_msl=500.0,
            height=50.0 - slope * 0.1 * k,
            v_F_n=(v_north, 0.0, v_down),
            heading_rad=None,
        )
        ownship.receive(message, t_ns)
    assert ownship.samples == 20
    return ownship.doubt


@pytest.mark.parametrize(("v_down", "doubt"), [(-3.0, ""), (3.0, "position contradicts the velocity"), (-2.0, "")])
def test_a_height_that_contradicts_the_vertical_velocity_is_noticed(v_down: float, doubt: str) -> None:
    assert climbing(v_down) == doubt


@pytest.mark.parametrize("v_north", [0.0, 8.0, 25.0])
@pytest.mark.parametrize("climb", [0.5, 1.0, -1.0])
def test_a_vertical_velocity_with_the_wrong_sign_is_noticed_at_any_speed(v_north: float, climb: float) -> None:
    assert climbing(climb, -climb, v_north) == "position contradicts the velocity"
    assert climbing(-climb, -climb, v_north) == ""

"""Three vehicles through one router: each record comes under its own vehicle's key."""

import pytest

from benchmarks import fleet_daemons
from benchmarks.fleet import PUBLISHED, measure


@pytest.mark.slow
def test_three_vehicles_through_one_router_do_not_mix() -> None:
    found = measure(3, 2.0)
    assert found["cross_talk"] == 0
    assert found["received_share_of_sent"] > 0.5  # on a machine of any speed
    assert found["wire_kbit_s_of_a_vehicle"] > 0.1 * found["payload_kbit_s_of_a_vehicle"]
    assert sum(rate for rate, _ in PUBLISHED.values()) == 101


@pytest.mark.slow
def test_each_of_two_daemons_publishes_its_own_leader() -> None:
    found = fleet_daemons.measure(2, 3, 10)
    assert found["vehicles_with_another_ones_leader"] == 0
    assert found["range_off_by_most"] < 0.1
    assert found["estimates_a_second_least"] > 20  # on a machine of any speed

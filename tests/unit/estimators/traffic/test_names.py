"""Names of tracks, where reports and echoes agree or do not."""

import numpy as np

from onboard.messages import Lifecycle
from tests.support.traffic import EAST, NAME, R0, V0, Sky, fly_with_reports, fly_with_scans, mean


def test_two_aircraft_with_one_address_are_two_tracks() -> None:
    sky, apart = Sky(), np.array([3000.0, 0.0, 0.0])
    fly_with_reports(sky, 5)
    for _ in range(15):
        sky.receive(sky.adsb(R0 + V0 * sky.t, V0))
        sky.receive(sky.adsb(R0 + apart - V0 * sky.t, -V0))
        sky.fly(1.0)
    first, second = sky.newest[NAME], sky.newest[f"{NAME}-2"]
    np.testing.assert_allclose(mean(first)[:3], R0 + V0 * sky.t, atol=2.0)
    np.testing.assert_allclose(mean(second)[:3], R0 + apart - V0 * sky.t, atol=2.0)
    assert "address" in first.reason
    assert "address" in second.reason
    assert set(sky.newest) == {NAME, f"{NAME}-2"}


def test_a_name_follows_its_reports_where_echoes_in_its_old_place_are_of_another_aircraft() -> None:
    """Echoes of another aircraft have drawn the track away, or the transponder reports a false position. Both
    positions are tracked, that of the echoes without a name."""
    sky, off = Sky(), 400.0 * EAST
    for k in range(14):
        sky.receive(sky.adsb(R0 + V0 * sky.t + (off if k >= 6 else 0.0), V0))
        fly_with_scans(sky, 10, (R0, V0))
    named = sky.newest[NAME]
    np.testing.assert_allclose(mean(named)[:3], R0 + V0 * sky.t + off, atol=5.0)
    assert named.reset_count == 1
    (unnamed,) = [e for name, e in sky.newest.items() if name.startswith("radar/") and e.valid]
    np.testing.assert_allclose(mean(unnamed)[:3], R0 + V0 * sky.t, atol=5.0)
    assert sum(e.valid for e in sky.newest.values()) == 2


def test_an_aircraft_that_did_move_continues_under_its_name() -> None:
    """It turned back while it sent no reports: the new ones fit each other, and nothing contradicts them."""
    sky = Sky()
    fly_with_reports(sky, 6)
    turn_time = sky.t
    sky.fly(9.0)
    back = R0 + V0 * turn_time
    for _ in range(6):
        sky.receive(sky.adsb(back - V0 * (sky.t - turn_time) + [400.0, 0, 0], -V0))
        sky.fly(1.0)
    e = sky.newest[NAME]
    assert e.reset_count == 1
    np.testing.assert_allclose(mean(e)[:3], back - V0 * (sky.t - turn_time) + [400.0, 0, 0], atol=3.0)
    assert set(sky.newest) == {NAME}


def test_a_transponder_switched_off_is_followed_by_radar_under_its_name() -> None:
    sky = Sky()
    for _ in range(10):
        sky.receive(sky.adsb(R0 + V0 * sky.t, V0))
        fly_with_scans(sky, 10, (R0, V0))
    fly_with_scans(sky, 200, (R0, V0))
    e = sky.newest[NAME]
    assert e.valid
    assert e.reason == "by radar/nose"
    np.testing.assert_allclose(mean(e)[:3], R0 + V0 * sky.t, atol=3.0)
    assert set(sky.newest) == {NAME}


def test_a_radar_track_takes_the_name_of_the_report_that_fits_it() -> None:
    sky, other = Sky(), (R0 + 800.0 * EAST, V0)
    fly_with_scans(sky, 50, (R0, V0), other)
    named = set(sky.newest)
    assert len(named) == 2
    sky.receive(sky.adsb(R0 + V0 * sky.t, V0))
    fly_with_scans(sky, 10, (R0, V0), other)
    (gone,) = [n for n in named if sky.newest[n].state is Lifecycle.SEARCHING]
    assert sky.newest[gone].reason == f"it is {NAME}"
    assert sky.newest[NAME].valid
    assert sum(e.valid for e in sky.newest.values()) == 2

"""How tracks begin, coast, are lost, continue, and end."""

import numpy as np
import pytest

from onboard.messages import Cause, Lifecycle, Reason
from tests.support.traffic import NAME, NORTH, R0, V0, Sky, fly_with_reports, fly_with_scans, mean


def test_a_track_coasts_is_lost_and_is_removed_with_a_last_estimate() -> None:
    sky = Sky()
    fly_with_reports(sky, 5)
    silent = sky.t - 1.0
    since: dict[str, float] = {}
    for _ in range(350):
        sky.fly(0.1)
        e = sky.newest[NAME]
        since.setdefault(str(e.state), sky.t - silent)
        assert e.valid is (e.state in (Lifecycle.TRACKING, Lifecycle.COASTING))
    assert list(since) == ["tracking", "coasting", "lost", "searching"]
    assert [since[s] for s in ("coasting", "lost", "searching")] == pytest.approx([3.0, 10.0, 30.0], abs=0.2)
    assert sky.newest[NAME].mean is None
    count = len(sky.published)
    sky.fly(1.0)
    assert len(sky.published) == count


def test_after_jamming_a_radar_s_track_continues_under_its_name_and_false_alarms_do_not_move_it() -> None:
    sky = Sky()
    fly_with_scans(sky, 60, (R0, V0))
    (name,) = sky.newest
    rng = np.random.default_rng(5)
    for _ in range(80):  # nothing but false alarms, close to where it should be
        sky.scan(R0 + V0 * sky.t + rng.normal(0, 250.0, (4, 3)))
        sky.fly(0.1)
    np.testing.assert_allclose(mean(sky.newest[name])[:3], R0 + V0 * sky.t, atol=40.0)
    fly_with_scans(sky, 30, (R0, V0))
    assert sky.newest[name].state is Lifecycle.TRACKING
    np.testing.assert_allclose(mean(sky.newest[name])[:3], R0 + V0 * sky.t, atol=10.0)
    assert [n for n, e in sky.newest.items() if e.valid] == [name]


def test_false_alarms_make_no_tracks_seed_3() -> None:
    sky, rng = Sky(), np.random.default_rng(3)
    for _ in range(100):
        sky.scan(rng.uniform(-3000, 3000, (8, 3)) * [1, 1, 0.2])
        sky.fly(0.1)
    assert sky.published == []
    assert sky.verdicts["initialising"] > 650


def test_two_that_cross_keep_their_tracks_seed_4() -> None:
    """Only by radar; 25 m apart where they cross, at an angle of 60 degrees."""
    sky, rng = Sky(), np.random.default_rng(4)
    at = np.array([1200.0, 0.0, -60.0])
    va, vb = np.array([26.0, 15.0, 0.0]), np.array([26.0, -15.0, 0.0])
    lines = [(at - 10 * va, va), (at - 10 * vb + [0, 0, 25.0], vb)]
    names = {}
    for k in range(200):
        places = [r + v * sky.t + rng.normal(0, 3.0, 3) for r, v in lines]
        sky.scan([p for p in places if rng.uniform() < 0.9][:: 1 if k % 2 else -1])
        sky.fly(0.1)
        if k == 50:
            names = {n: int(mean(e)[4] < 0) for n, e in sky.newest.items() if e.valid}
    assert len(names) == 2
    for name, which in names.items():
        r, v = lines[which]
        np.testing.assert_allclose(mean(sky.newest[name])[:3], r + v * sky.t, atol=12.0)


def test_a_reset_removes_all_tracks_with_its_reason() -> None:
    sky = Sky()
    fly_with_reports(sky, 3)
    sky.estimator.reset(Reason(Cause.REBOOTED, "the autopilot has rebooted"))
    sky.fly(0.2)
    assert (sky.newest[NAME].state, sky.newest[NAME].reason) == (Lifecycle.SEARCHING, "the autopilot has rebooted")
    fly_with_reports(sky, 3)
    assert sky.newest[NAME].valid


def test_a_track_whose_filter_fails_is_removed_and_the_others_go_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """One covariance is broken by hand: no input is known that does it."""
    sky = Sky(filter="ukf")
    for k in (1, 2, 3):
        sky.receive(sky.adsb(R0 + 500.0 * k * NORTH, V0, icao=k))
    sky.fly(0.5)
    batch = sky.estimator._tracker.batch
    broken = batch._state.covariance.copy()
    broken[1] = -np.eye(15)
    monkeypatch.setattr(batch, "_state", batch._state._replace(covariance=broken))
    sky.fly(0.5)
    assert sky.verdicts["numerical"] == 1
    assert sky.newest["icao/000002"].state is Lifecycle.SEARCHING
    assert {n for n, e in sky.newest.items() if e.mean is not None} == {"icao/000001", "icao/000003"}

"""Floods of ADS-B addresses: what is computed and published stays bounded, and who is near is always published."""

from collections import Counter

import numpy as np

from onboard.estimators.traffic.track import Track
from tests.support.traffic import NAME, R0, V0, Sky, fly_with_reports

FAR = np.array([15_000.0, 10_000.0, -2_000.0])


def flood(sky: Sky, first: int, count: int) -> None:
    """Reports of that many addresses, some 18 km away."""
    for n in range(count):
        r = FAR + np.array([10.0 * (n % 100), 100.0 * (n // 100 % 100), 0.0])
        sky.receive(sky.adsb(r, V0, icao=first + n))


def test_publications_are_bounded_and_the_nearest_is_in_all_of_them() -> None:
    sky = Sky()
    fly_with_reports(sky, 3)
    (near,) = sky.newest
    for second in range(3):
        flood(sky, 0x100000, 900)
        sky.receive(sky.adsb(R0 + V0 * sky.t, V0))
        sky.published.clear()
        sky.fly(1.0)
        by_time = Counter(e.t_ns for e in sky.published)
        assert max(by_time.values()) <= 100, second
        assert sum(e.target == near for e in sky.published) == len(by_time) >= 9


def test_every_track_is_published_in_its_turn() -> None:
    sky = Sky(max_reported=1000)
    for _ in range(10):
        flood(sky, 0x100000, 400)
        sky.fly(0.2)
    sky.published.clear()
    sky.fly(1.0)
    assert len({e.target for e in sky.published}) == 400


def test_a_flood_of_new_addresses_costs_no_report_of_a_known_one() -> None:
    sky = Sky()
    fly_with_reports(sky, 3)
    (near,) = sky.newest
    before = sky.verdicts["fused"]
    for second in range(2):
        flood(sky, 0x100000 + 0x10000 * second, 10_000)
        sky.receive(sky.adsb(R0 + V0 * sky.t, V0))
        sky.fly(1.0)
    assert sky.verdicts["fused"] == before + 2
    assert sky.newest[near].valid


def test_ten_thousand_addresses_cost_no_more_than_two_hundred_and_the_nearest_get_in() -> None:
    sky = Sky()
    for k in range(8):
        flood(sky, 0x100000 + 1000 * k, 1000)
        sky.fly(0.2)
    assert len(sky.estimator._tracker.tracks) == sky.estimator._config.max_reported == 200
    flood(sky, 0x300000, 20)
    sky.receive(sky.adsb(R0 + V0 * sky.t, V0))
    sky.fly(0.2)
    assert len(sky.estimator._tracker.tracks) == 200
    assert NAME in {t.target for t in sky.estimator._tracker.tracks}
    before = {t.target for t in sky.estimator._tracker.tracks}
    sky.receive(sky.adsb(2.0 * FAR, V0, icao=0x200000))
    sky.fly(0.2)
    assert {t.target for t in sky.estimator._tracker.tracks} == before, "a farther one takes no place"


def test_a_track_s_sources_stay_few_however_many_radars_there_are() -> None:
    track = Track(target="radar/1", key=None, number=1, fused_ns=0, sources={})
    for n in range(1000):
        track = track.fused(n, f"radar/{n}")
    assert len(track.sources) <= 16
    assert track.sources["radar/999"] == 999

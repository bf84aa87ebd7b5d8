"""How the study of Oh & Johnson's paper flies its filters: many at once, failures, late images, cameras."""

import msgspec
import numpy as np
import pytest

from onboard.filters.belief import Belief, FilterError
from simlink.scenarios.profiles import GaussMarkov
from simlink.scenarios.scenario import load_scenario
from simlink.scenarios.vehicle import Nav
from studies.relative_motion.flights import Flights, fly_many
from studies.relative_motion.formation import Filter, Images, ImageUpdate, Lateness, Method, Setting, track
from studies.relative_motion.methods import HONEST, PAPER_MENDED, TUNED
from studies.relative_motion.scores import score, truth_of

SCENARIO = load_scenario("formation")


@pytest.fixture(scope="module")
def flights() -> Flights:
    return fly_many(SCENARIO, [1, 2, 3], duration=20.0)


def test_the_gate_holds_and_the_considered_size_stays_seed_1(flights: Flights) -> None:
    found = track(flights, Setting(SCENARIO.camera), HONEST).one(0)
    started = np.isfinite(found.mean[:, 6])
    assert np.ptp(found.mean[started, 6]) < 1e-9
    assert np.nanmax(found.nis[found.fused]) <= 16.27
    ungated = track(flights, Setting(SCENARIO.camera), TUNED).one(0)
    assert ungated.fused.sum() == np.isfinite(ungated.nis).sum() > 400


def test_many_flights_are_tracked_as_each_alone_seeds_1_to_3(flights: Flights) -> None:
    together = track(flights, Setting(SCENARIO.camera), PAPER_MENDED)
    for b, seed in enumerate(flights.seeds):
        alone = track(fly_many(SCENARIO, [seed], duration=20.0), Setting(SCENARIO.camera), PAPER_MENDED)
        np.testing.assert_allclose(together.mean[b], alone.mean[0], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(together.nis[b], alone.nis[0], rtol=1e-9, atol=1e-9)


def _fragile(at_once: bool) -> Method:
    """The tuned filter, which an image far aside breaks: at once, or at the next prediction."""

    def make(setting: Setting) -> Filter:
        inner = TUNED.make(setting)

        def update(state: Belief, images: Images) -> ImageUpdate:
            broken = images.points[:, 0, 0] > 5.0
            if at_once and broken.any():
                raise FilterError("made to fail")
            after = inner.update(state, images)
            covariance = np.where(broken[:, None, None], np.nan, after.state.covariance)
            return after._replace(state=Belief(after.state.mean, covariance))

        return inner._replace(update=update)

    return Method("fragile", "breaks", make)


@pytest.mark.parametrize(("at_once", "when"), [(True, 8.0), (False, 8.02)])
def test_a_flight_that_fails_is_taken_out_and_the_rest_fly_on_seeds_1_to_3(
    flights: Flights, at_once: bool, when: float
) -> None:
    points = flights.image_points.copy()
    points[1, flights.image_t == 8.0] = 10.0
    found = track(flights._replace(image_points=points), Setting(SCENARIO.camera), _fragile(at_once))
    assert found.failed_at[1] == pytest.approx(when)
    assert np.isnan(found.mean[1, flights.nav_t > when]).all()
    assert np.isfinite(found.mean[1, (flights.nav_t > 1.0) & (flights.nav_t < 7.9)]).all()
    whole = track(flights, Setting(SCENARIO.camera), TUNED)
    for b in (0, 2):
        np.testing.assert_allclose(found.mean[b], whole.mean[b], rtol=1e-9, atol=1e-9)
        assert np.isnan(found.one(b).failed_at)


def test_late_stamps_show_as_an_old_image_and_late_delivery_as_a_prediction_seed_1(flights: Flights) -> None:
    setting = Setting(SCENARIO.camera)
    on_time, stamped, delivered = (
        track(flights, setting, TUNED, late) for late in (Lateness(), Lateness(stamp=4), Lateness(delivery=4))
    )
    first = [int(np.flatnonzero(np.isfinite(tracks.mean[0, :, 0]))[0]) for tracks in (on_time, stamped, delivered)]
    assert first == [0, 4, 4]
    # the same images fused at the same times, reported four samples later: they differ by that prediction only
    assert np.array_equal(on_time.nis, delivered.nis, equal_nan=True)
    truth = truth_of(flights.one(0))[:, :3]
    late = flights.nav_t > 10.0
    error = [np.linalg.norm(x.mean[0, late, :3] - truth[late], axis=1).mean() for x in (on_time, delivered)]
    assert error[1] == pytest.approx(error[0], rel=0.1)
    assert not np.array_equal(on_time.nis, stamped.nis, equal_nan=True)


def test_a_turned_and_displaced_camera_costs_a_filter_that_knows_it_nothing_seed_1() -> None:
    mounted = msgspec.structs.replace(
        SCENARIO.camera, mount_rpy_deg=(3.0, -5.0, 4.0), mount_offset=(0.4, 0.3, -0.2)
    )
    scenario = msgspec.structs.replace(SCENARIO, camera=mounted)
    flights = fly_many(scenario, [1], duration=20.0)
    right = score(1, flights.one(0), track(flights, Setting(mounted), HONEST).one(0))
    wrong = score(1, flights.one(0), track(flights, Setting(SCENARIO.camera), HONEST).one(0))
    assert right.position_ft < 5.0
    assert wrong.position_ft > right.position_ft + 3.0


def test_a_known_attitude_error_widens_the_reported_covariance_seed_1(flights: Flights) -> None:
    nav = Nav(attitude_deg=GaussMarkov(sigma=0.5))
    without, known = (track(flights, Setting(SCENARIO.camera, nav=n), HONEST).one(0) for n in (Nav(), nav))
    assert np.array_equal(without.mean, known.mean, equal_nan=True)
    added = known.covariance[-1] - without.covariance[-1]
    place, velocity = without.mean[-1, :3], without.mean[-1, 3:6]
    turns = np.radians(0.5) * np.array([[*np.cross(e, place), *np.cross(e, velocity), 0, 0, 0] for e in np.eye(3)])
    expected = turns.T @ turns  # a small turn about north, east and down each moves both vectors
    np.testing.assert_allclose(added, expected, rtol=1e-6, atol=1e-12)

"""The leader's course."""

import math

import numpy as np
import pytest

from onboard.autopilot.guidance.course import Course
from onboard.autopilot.guidance.states import TURNED_S, Activity

DT = 0.05


def fly(course: Course, speed: float, direction: float, seconds: float, sigma: float = 0.5) -> Course:
    v = speed * np.array([math.cos(direction), math.sin(direction), 0.0])
    for _ in range(round(seconds / DT)):
        course.learn(v, sigma**2 * np.eye(3), DT)
    return course


def test_a_velocity_that_may_be_noise_teaches_nothing() -> None:
    """5.9 +- 2.2 m/s, which a take-off showed of a leader that hovered."""
    course = fly(Course(), 5.9, 1.0, 20.0, sigma=2.2)
    assert (course.value, course.is_learnt) == (None, False)
    assert fly(Course(), 0.9, 1.0, 20.0, sigma=0.01).value is None
    assert fly(Course(), 10.0, 1.0, 0.9).value is None
    assert fly(Course(), 10.0, 1.0, 1.1).value == 1.0


def test_a_leader_whose_velocity_is_unsure_along_the_range_alone_sets_off() -> None:
    """A real one after a restart, 57 m north of a vehicle that stood: 5 m/s, 3 to 8 unsure along the range."""
    course, v = Course(), np.array([3.0, 4.0, 0.0])
    for _ in range(round(1.0 / DT)):
        course.learn(v, np.diag([9.0, 0.25, 1.0]), DT)
    assert course.motion.state is Activity.SETS_OFF
    assert course.value is None  # where to is not known


def test_a_leader_that_may_as_well_rest_along_the_range_does_not_set_off() -> None:
    course = Course()
    for _ in range(round(20.0 / DT)):
        course.learn(np.array([5.0, 0.2, 0.0]), np.diag([9.0, 0.25, 1.0]), DT)
    assert (course.value, course.motion.state) == (None, Activity.RESTS)


def test_a_leader_that_has_stopped_and_may_as_well_rest_does() -> None:
    """A real PX4 was led round one that had stopped, by a velocity of 2 +- 1.5 m/s that was noise."""
    course = fly(fly(Course(), 5.0, 1.0, 2.0), 0.8, 1.0, 0.5)
    assert course.motion.state is Activity.SETS_OFF
    fly(course, 2.0, 2.5, 2.5, sigma=1.5)
    assert course.motion.state is Activity.SETS_OFF
    fly(course, 2.0, 2.5, 1.0, sigma=1.5)
    assert course.motion.state is Activity.RESTS


@pytest.mark.parametrize(
    ("v", "state"),
    [
        ((5.0, 0.0, 0.0), Activity.FLIES),
        ((-5.0, 0.5, 0.0), Activity.BACKS_UP),
        ((0.5, 0.0, 0.0), Activity.RESTS),
    ],
)
def test_what_the_leader_did_before_a_restart_it_does_after_it(v: tuple[float, ...], state: Activity) -> None:
    course = Course()
    course.resume(0.3, np.array(v))
    assert (course.value, course.is_learnt, course.motion.state) == (0.3, True, state)


def test_it_is_held_in_a_hover_and_when_the_leader_backs_up() -> None:
    course = fly(Course(), 10.0, 1.0, 2.0)
    fly(course, 0.2, -2.0, 10.0)
    assert course.value == 1.0
    fly(course, 4.0, 1.0 + math.pi, TURNED_S - 1.0)
    assert course.value == 1.0
    assert course.rate(np.array([-4.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])) == 0.0


def test_between_back_and_ahead_it_keeps_what_it_has() -> None:
    course = fly(Course(), 10.0, 1.0, 2.0)
    fly(course, 0.2, -2.0, 1.0)
    fly(course, 4.0, 1.0 + math.radians(105), 2.0)
    fly(course, 4.0, 1.0 + math.radians(95), 2.0)  # neither within 80 degrees again, nor surely another course
    assert course.value == 1.0
    fly(course, 4.0, 1.0 + math.radians(75), 2.0)
    assert course.value == pytest.approx(1.0 + math.radians(75))


@pytest.mark.parametrize("sigma", [0.2, 2.5])
def test_a_leader_that_backs_up_for_long_has_turned(sigma: float) -> None:
    """Also one whose velocity becomes unsure meanwhile: a doubt keeps nothing."""
    course = fly(Course(), 10.0, 1.0, 2.0)
    fly(course, 0.2, -2.0, 1.0)
    fly(course, 4.0, 1.0 + math.pi, 2.0)
    fly(course, 4.0, 1.0 + math.pi, TURNED_S, sigma)
    assert course.value == pytest.approx(1.0 - math.pi)


def test_a_turn_that_is_flown_unsurely_is_no_leader_that_backs_up() -> None:
    """12 m wide at 3 m/s, of which the velocity is known to 0.9 m/s, and hardly at all half way: a real leader
    turned so, and was taken to back up to the end of the flight."""
    course = fly(Course(), 6.0, 0.0, 3.0)
    for k in range(126):
        fly(course, 3.0, 0.5 * DT * k, DT, sigma=6.0 if 40 < k < 80 else 0.9)
        assert not course.backs_up
    fly(course, 3.0, math.pi, 1.0, sigma=0.9)
    assert not course.backs_up
    assert course.value == pytest.approx(math.pi)


def test_it_follows_a_turn_of_any_size() -> None:
    course = fly(Course(), 10.0, 0.0, 2.0)
    for k in range(100):
        fly(course, 10.0, 0.05 * k, DT)
    assert course.value == pytest.approx(math.remainder(0.05 * 99, 2 * math.pi))
    assert course.rate(np.array([10.0, 0.0, 0.0]), np.array([1.0, 2.0, 0.0])) == pytest.approx(0.2)


def test_a_supposed_course_is_not_flipped_either() -> None:
    """A leader that hovers first, and then backs up towards us."""
    course = Course()
    course.start(0.3)
    fly(course, 4.0, 0.3 + math.pi, 5.0)
    assert (course.value, course.is_learnt) == (0.3, False)
    fly(course, 4.0, 0.5, 5.0)
    assert (course.value, course.is_learnt) == (0.5, True)

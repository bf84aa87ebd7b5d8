"""The published range of a leader that turns across our line of sight, which looks like one that flies away."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from onboard.arrays import Array
from tests.support.streams import Flight, Kinematics, S, Stream, advance_once, heartbeat, make_config

START_S: Final = 5.0
SPEED_M_S: Final = 6.0
DISTANCE_M: Final = 45.0
SEEDS: Final = (1, 2)


@dataclass(frozen=True)
class TurningLeader(Flight):
    """The leader turns right out of our heading. We keep abreast of it and close in, so its bearing stays."""

    radius: float | None = None
    turn_start: float = START_S  # s of boot time
    turn_rate: float = 0.1  # rad/s
    closing_speed: float = 4.0  # m/s

    def at(self, t: float, ahead: float = 0.0) -> Kinematics:
        since, turned = t - START_S, self.turn_rate * max(t - self.turn_start, 0.0)
        radius = SPEED_M_S / self.turn_rate
        straight = SPEED_M_S * (min(t, self.turn_start) - START_S)
        c, s = math.cos(turned), math.sin(turned)
        a = SPEED_M_S * self.turn_rate if t > self.turn_start else 0.0
        r = np.array([DISTANCE_M + straight + radius * s, radius * (1.0 - c), -50.0])
        if ahead:
            roll = math.atan(a / 9.80665)
            return Kinematics(r, SPEED_M_S * np.array([c, s, 0.0]), a * np.array([-s, c, 0.0]), (roll, 0, turned))
        return Kinematics(
            np.array([self.closing_speed * since, r[1], -50.0]),
            np.array([self.closing_speed, SPEED_M_S * s, 0.0]),
            np.array([0.0, a * c, 0.0]),
            (0, 0, 0),
        )


# Each flight, and for a re-acquisition the time without images, s of boot time.
CASES: Final = (
    (TurningLeader(), None),
    (TurningLeader(turn_rate=0.12, closing_speed=5.0), None),
    (TurningLeader(turn_start=15.0, closing_speed=6.0), (8.0, 15.5)),
    (TurningLeader(turn_start=12.0, closing_speed=5.0), (8.0, 15.0)),
)


def flown(flight: TurningLeader, blind: tuple[float, float] | None, seed: int) -> Array:
    """Estimated range, its standard deviation and the true range (n, 3), m, from the (last) start until the leader
    is seen edge-on."""
    edge_on = flight.turn_start + math.radians(75.0) / flight.turn_rate
    begin = START_S if blind is None else blind[1]
    stream = Stream(
        flight=flight,
        t0=START_S,
        t1=edge_on,
        seed=seed,
        sparse=True,
        images=lambda t: blind is None or not blind[0] <= t < blind[1],
    )
    run = advance_once([heartbeat(round(START_S * S)), *(item.message for item in stream.items())], make_config())

    def rows() -> Iterator[tuple[float, float, float]]:
        for estimate in run.estimates:
            if estimate.valid and estimate.mean is not None and estimate.t_ns / S > begin:
                r, P = np.array(estimate.mean)[:3], np.array(estimate.covariance)[:3, :3]
                range_ = float(np.linalg.norm(r))
                sigma = float(np.sqrt(r @ P @ r)) / range_
                yield range_, sigma, float(np.linalg.norm(flight.relative(estimate.t_ns / S)[0]))

    return np.array(list(rows()))


def test_two_sigmas_of_the_range_of_a_turning_leader_cover_it_as_often_as_a_gaussian_seeds_1_and_2() -> None:
    range_, sigma, true = np.vstack([flown(*case, seed) for case in CASES for seed in SEEDS]).T
    assert len(range_) > 2500
    assert np.mean(true < range_ - 2.0 * sigma) < 0.025
    assert np.mean(true > range_ + 2.0 * sigma) < 0.025
    assert np.median(sigma / range_) < 0.3  # a bound that covers everything says nothing

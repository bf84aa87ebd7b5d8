"""Reports and ranges of the leader as rows of an update.

A row is a value with its white noise, and the errors that last and that it has a share of. These are a part of
each particle's state (`particles.Bias`): so a report corrects the size as far as its own bias allows, and a bias
is known as well as the images show the position.
"""

from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader.hypotheses.motion import ACCELERATION, POSITION, VELOCITY
from onboard.estimators.leader.hypotheses.particles import Bias, Particles

ABOUT_DOWN: Final = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
REPORT_POSITION: Final = ("report_north", "report_east", "report_down")  # names of biases: of a report's position,
OWN_VELOCITY: Final = ("own_north", "own_east", "own_down")  # of our own velocity,
TURN: Final = "own_yaw"  # and of our yaw, which turns all that the camera shows;
DELAY: Final = "report_delay"  # of the time at which a report was true;
DISTANCE: Final = "range"  # and of a range


class LinearRows(NamedTuple):
    """Derivatives H (K, m, W), innovations (K, m), white noise R_y (m, m), and the columns that are considered and
    not estimated."""

    H: Array
    innovations: Array
    R_y: Array
    considered: tuple[int, ...] = ()


class Report(NamedTuple):
    """r_FL_n and v_L_n, true at `t_ns`, with white noise R_y (6, 6), very large for what is not reported; the
    `biases` of REPORT_POSITION, OWN_VELOCITY, TURN and DELAY; and whether it can be `trusted`, or may be false."""

    t_ns: int
    r: Array
    v: Array
    R_y: Array
    biases: tuple[Bias, ...]
    trusted: bool

    def rows(self, particles: Particles) -> LinearRows:
        """Return its rows for particles that have its biases.

        The delay is considered: in a turn a delay shortens positions and velocities alike, as a smaller size does,
        and the derivatives do not show that. They hold for a straight line."""
        x = particles.means
        K, W = x.shape
        at, of_v = ([particles.column(name) for name in names] for names in (REPORT_POSITION, OWN_VELOCITY))
        turn, delay = particles.column(TURN), particles.column(DELAY)
        turned = x[:, POSITION] @ ABOUT_DOWN.T
        H = np.zeros((K, 6, W))
        H[:, :3, POSITION], H[:, 3:, VELOCITY] = np.eye(3) - x[:, turn, None, None] * ABOUT_DOWN, np.eye(3)
        H[:, range(3), at] = H[:, range(3, 6), of_v] = 1.0
        H[:, :3, turn], H[:, :3, delay], H[:, 3:, delay] = -turned, -x[:, VELOCITY], -x[:, ACCELERATION]
        late = x[:, delay, None]
        r = self.r - (x[:, POSITION] - x[:, turn, None] * turned + x[:, at] - late * x[:, VELOCITY])
        v = self.v - (x[:, VELOCITY] + x[:, of_v] - late * x[:, ACCELERATION])
        return LinearRows(H, np.hstack([r, v]), self.R_y, (delay,))


class Range(NamedTuple):
    """A distance in m, true at `t_ns`, with its white noise, a standard deviation, and what lasts of its error."""

    t_ns: int
    distance: float
    sigma: float
    biases: tuple[Bias, ...]
    trusted: bool = True

    def rows(self, particles: Particles) -> LinearRows:
        """The row of it, of particles that has its bias."""
        x, at = particles.means, particles.column(DISTANCE)
        range_ = np.linalg.norm(x[:, POSITION], axis=1)
        H = np.zeros((len(x), 1, x.shape[1]))
        H[:, 0, POSITION], H[:, 0, at] = x[:, POSITION] / range_[:, None], 1.0
        return LinearRows(H, (self.distance - range_ - x[:, at])[:, None], np.array([[self.sigma**2]]))


Auxiliary = Report | Range

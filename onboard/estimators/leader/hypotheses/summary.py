"""Mean and covariance of all particles, now and a moment later, and the published states.

Published are the states of Oh & Johnson's model, and more: the nine of `models.relative_motion` first,
[r_FL_n (3), v_FL_n (3), b, a_lat, a_long], then
- `a_along`: acceleration along the track (m/s^2), which the paper leaves out; the axes of all three are those of
  `geometry.path_axes`;
- `heading`: of the heading, rad from north, not wrapped;
- `bank_error`: rad beyond the bank that the acceleration requires, tan(bank) = a_right / (g - a_down). Lift, or
  the rotors' thrust, turns any aircraft, and the wing stands square to it.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.compiled import FILLING, INDICES, MAKING, OUT, ROWS, VECTOR, kernel, packed, record
from onboard.estimators.leader import assumptions as given
from onboard.estimators.leader.assumptions import LeaderModel
from onboard.estimators.leader.hypotheses import motion
from onboard.estimators.leader.hypotheses.motion import (
    ACCELERATION,
    AX,
    AY,
    AZ,
    HEADINGS,
    MOTION,
    NUMBER,
    POSITION,
    VELOCITY,
    VX,
    VY,
    VZ,
)
from onboard.estimators.leader.hypotheses.particles import Particles
from onboard.estimators.leader.hypotheses.places import Place, places
from onboard.geometry.path_axes import MIN_COURSE_SPEED_M_S, path_angles
from onboard.models import relative_motion
from onboard.models.relative_motion import A_LAT, A_LONG, SIZE

A_ALONG: Final = 9
HEADING: Final = 10
BANK_ERROR: Final = 11
COMPONENTS: Final = (*relative_motion.COMPONENTS, "a_along", "heading", "bank_error")
UNITS: Final = (*relative_motion.UNITS, "m/s^2", "rad", "rad")
# The components of a summary (N,): position, velocity and acceleration, in the same places as a particle's, ...
LOG_SIZE: Final = motion.BANK_ERROR  # ... the size, and, as in what is published, HEADING and BANK_ERROR
N: Final = 12  # states of a summary, and those that are published
# of a summary, and of a particle: what both of them have
OF_SUMMARY: Final = (*range(LOG_SIZE), LOG_SIZE, BANK_ERROR)
OF_PARTICLE: Final = (*range(LOG_SIZE), motion.LOG_SIZE, motion.BANK_ERROR)
IDENTITY: Final = np.eye(N)
MOVES: Final = np.zeros((N, N))
MOVES[POSITION, VELOCITY] = MOVES[VELOCITY, ACCELERATION] = np.eye(3)
CURVES: Final = np.zeros((N, N))
CURVES[POSITION, ACCELERATION] = np.eye(3)


class Summary(NamedTuple):
    """Mean (12,) and covariance (12, 12) of [r_FL_n, v_L, a_L, log of the size, heading, bank's error], vectors in
    n. Where the range is open, also the places where the leader may be."""

    mean: Array
    covariance: Array
    places: tuple[Place, ...] = ()

    def after(self, dt: float, moved: Array) -> "Summary":
        """`dt` seconds later, at constant acceleration; we have moved by `moved` (3,) m, in n."""
        if dt <= 0.0:
            return self
        F = IDENTITY + dt * MOVES + 0.5 * dt * dt * CURVES
        mean = F @ self.mean
        mean[POSITION] -= moved
        return Summary(mean, F @ self.covariance @ F.T, tuple(p.after(dt, moved) for p in self.places))

    def range_sigma(self) -> float:
        """The standard deviation of the range, as a share of it."""
        x, y, z = self.mean[POSITION].tolist()  # three numbers: Python's arithmetic is fast
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = self.covariance[POSITION, POSITION].tolist()
        along = x * x * xx + y * y * yy + z * z * zz + 2.0 * (x * y * xy + x * z * xz + y * z * yz)
        return math.sqrt(max(along, 0.0)) / float(x * x + y * y + z * z)

    def direction_sigma(self) -> float:
        """The standard deviation of the direction where it is least certain, rad."""
        r = self.mean[POSITION]
        across = np.eye(3) - np.outer(r, r) / float(r @ r)
        largest = float(np.linalg.eigvalsh(across @ self.covariance[POSITION, POSITION] @ across)[-1])
        return math.sqrt(max(largest, 0.0)) / float(np.linalg.norm(r))


def summarise(settings: LeaderModel, particles: Particles) -> Summary:
    """Reduce the particles to one Gaussian, with the errors of our attitude and velocity.

    It is one about the geometric mean range: an open range has a long tail to the far side, which drags a mean
    with it. Once the range is resolved, it is one about its median: from behind, the many headings that are not
    quite on the course all mean a nearer leader, and drag a mean to that side."""
    w = np.exp(particles.log_weights)
    if particles.heading_observed:
        about = math.atan2(float(w @ np.sin(particles.headings)), float(w @ np.cos(particles.headings)))
        period = 2.0 * math.pi
    else:
        about, period = float(particles.headings[int(w.argmax())]), math.pi
    cloud = particles.headings, particles.means, particles.covariances
    mean, P, log_ranges = moments(*cloud, w, about, period)
    centre(mean, P, w, log_ranges, log_ranges.argsort())
    by_points = 0.0
    if particles.keypoint_bias:  # it makes a heading wrong, the more the range, the less is seen of the wing
        line = mean[None, POSITION] / np.linalg.norm(mean[POSITION])
        seen = float(motion.visible(mean[HEADING : HEADING + 1], line, 0.0)[0])
        by_points = (particles.keypoint_bias * (1.0 - seen**2)) ** 2
    add_ours(P, mean, settings.misalignment, settings.own_velocity, by_points)
    P[HEADING, HEADING] += settings.misalignment[2] ** 2
    whole = Summary(mean, P)
    if whole.range_sigma() <= given.MAX_RESOLVED_RANGE_SIGMA:
        return whole

    def ours(r_FL_n: Array) -> Array:
        found = np.zeros((6, 6))
        add_ours(found, r_FL_n, settings.misalignment, settings.own_velocity, by_points)
        return found

    return whole._replace(
        places=places(w, particles.means[:, MOTION], particles.covariances[:, MOTION, MOTION], ours)
    )


@kernel(**MAKING)
def _components(heading, x, about, period, row):
    """A particle's mean as components of a summary, into `row`.

    Headings repeat after `period`."""
    for i in range(LOG_SIZE):
        row[i] = x[i]
    row[HEADING] = heading - period * np.rint((heading - about) / period)
    row[LOG_SIZE] = x[motion.LOG_SIZE]
    row[BANK_ERROR] = x[motion.BANK_ERROR]


@kernel((packed(NUMBER, 1), packed(NUMBER, 2), packed(NUMBER, 3), packed(NUMBER, 1), NUMBER, NUMBER), **MAKING)
def moments(headings, means, P, w, about, period):
    """Mean (N,) and covariance (N, N) of particles (`particles.Particles`) with weights w (K,), and the logarithms
    of their ranges (K,). Each heading is taken as near to `about` as it may be: it repeats after `period`, rad."""
    count, mean, S, row = w.shape[0], np.zeros(N), np.zeros((N, N)), np.zeros(N)
    log_ranges, within, flat = np.empty(count), np.zeros(P.shape[1] * P.shape[1]), P.reshape(count, -1)
    width = S.shape[1]  # not known to the compiler: `gaussian.correct`
    for k in range(count):
        x = means[k]
        _components(headings[k], x, about, period, row)
        for i in range(N):
            mean[i] += w[k] * row[i]
        log_ranges[k] = 0.5 * np.log(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
    for k in range(count):
        _components(headings[k], means[k], about, period, row)
        for i in range(N):
            row[i] -= mean[i]
        for i in range(N):
            share = w[k] * row[i]
            for j in range(width):
                S[i, j] += share * row[j]
        for i in range(within.shape[0]):
            within[i] += w[k] * flat[k, i]
    for i in range(len(OF_SUMMARY)):
        for j in range(len(OF_SUMMARY)):
            S[OF_SUMMARY[i], OF_SUMMARY[j]] += within[OF_PARTICLE[i] * P.shape[1] + OF_PARTICLE[j]]
    return mean, S, log_ranges


@kernel(**FILLING)
def _quantile(probability, w, x, order):
    """A quantile of numbers x (K,) with weights w (K,), sorted by `order`, interpolated linearly."""
    total, last, before = 0.0, 0.0, x[order[0]]
    for k in order:
        middle = total + 0.5 * w[k]
        if middle >= probability:
            share = (probability - last) / (middle - last) if total > 0.0 else 1.0
            return before + share * (x[k] - before)
        total, last, before = total + w[k], middle, x[k]
    return before


@kernel((HEADINGS, OUT, VECTOR, VECTOR, INDICES), **MAKING)
def centre(mean, S, w, log_ranges, order):
    """Move the mean (N,) to the geometric mean of the ranges of particles with weights w (K,), or, the more the
    range is resolved, to their median, by their `order`, with what goes with the range; and the covariance (N, N)
    to the second moments about it there, in place. An open range's is widened towards the near end of the
    particles."""
    square, along, by = mean[0] ** 2 + mean[1] ** 2 + mean[2] ** 2, 0.0, np.empty(N)
    for i in range(N):
        by[i] = S[i, 0] * mean[0] + S[i, 1] * mean[1] + S[i, 2] * mean[2]
        along += by[i] * mean[i] if i < 3 else 0.0
    is_resolved = min(max(2.0 - np.sqrt(max(along, 0.0)) / square / given.MAX_RESOLVED_RANGE_SIGMA, 0.0), 1.0)
    log_range = 0.0
    for k in range(w.shape[0]):
        log_range += w[k] * log_ranges[k]
    if is_resolved > 0.0:
        log_range += is_resolved * (_quantile(0.5, w, log_ranges, order) - log_range)
    range_ = np.exp(log_range)
    step = (range_ - np.sqrt(square)) * np.sqrt(square) / along
    # Sigma understates the long near tail of an open range. The more open it is, the closer two sigmas come to the
    # 2.5 % quantile, which they reach for a Gaussian.
    near = 0.5 * (range_ - np.exp(_quantile(0.025, w, log_ranges, order)))
    missing = near * near * square / along**2 - 1.0 / along - step * step
    widening = step * step + (1.0 - is_resolved) * max(missing, 0.0)
    by[LOG_SIZE] = 0.0  # whatever moves the range, it is not the size
    for i in range(N):
        mean[i] += step * by[i]
        for j in range(N):
            S[i, j] += widening * by[i] * by[j]


@kernel((OUT, VECTOR, record(tuple, NUMBER, NUMBER, NUMBER), NUMBER, NUMBER), **FILLING)
def add_ours(S, r, misalignment, own_velocity, by_points):
    """Add to a covariance, which begins with position and velocity, what errors of our attitude and velocity cause
    of a leader at r (3,) m in n, and a variance of the range's logarithm by named points."""
    x, y, z = r[0], r[1], r[2]
    turned = (0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0)
    for i in range(3):
        for j in range(3):
            S[i, j] += by_points * r[i] * r[j]
            for n in range(3):
                S[i, j] += turned[i][n] * misalignment[n] ** 2 * turned[j][n]
        S[VX + i, VX + i] += own_velocity**2


_path_angles = kernel(**MAKING)(path_angles)


@kernel(**MAKING)
def _derivatives(known, dt, J):
    """Fill in the derivatives of what is published.

    Those of the leader's components (N,) by a summary `dt` seconds before, into J (N, N); and its a_lat, a_long
    and a_along, which alone are not linear but for the size."""
    J[:] = 0.0
    for i in range(3):
        J[i, i], J[i, VX + i], J[i, AX + i] = 1.0, dt, 0.5 * dt * dt
        J[VX + i, VX + i], J[VX + i, AX + i] = 1.0, dt
    J[SIZE, LOG_SIZE] = np.exp(known[LOG_SIZE])
    J[HEADING, HEADING] = J[BANK_ERROR, BANK_ERROR] = 1.0
    u, v, w = known[VX] + dt * known[AX], known[VY] + dt * known[AY], known[VZ] + dt * known[AZ]
    c, s, cosine, sine = _path_angles(
        u, v, w, known[HEADING]
    )  # one that hovers has its accelerations along its heading
    level, right = c * known[AX] + s * known[AY], c * known[AY] - s * known[AX]
    a = right, -sine * level - cosine * known[AZ], cosine * level - sine * known[AZ]
    J[A_LAT, AX], J[A_LAT, AY] = -s, c
    J[A_LONG, AX], J[A_LONG, AY], J[A_LONG, AZ] = -c * sine, -s * sine, -cosine
    J[A_ALONG, AX], J[A_ALONG, AY], J[A_ALONG, AZ] = c * cosine, s * cosine, -sine
    h = np.sqrt(u * u + v * v)
    if h > MIN_COURSE_SPEED_M_S:  # by course and climb, the axes turn with the velocity
        course, climb, rise = (-s / h, c / h, 0.0), (c * w, s * w, -h), h * h + w * w
        for i in range(3):
            J[A_LAT, VX + i] = -level * course[i]
            J[A_LONG, VX + i] = -sine * right * course[i] - a[2] * climb[i] / rise
            J[A_ALONG, VX + i] = cosine * right * course[i] + a[1] * climb[i] / rise
        for i in range(3):
            for row in (A_LAT, A_LONG, A_ALONG):
                J[row, AX + i] += dt * J[row, VX + i]
    return a


@kernel((VECTOR, ROWS, NUMBER, VECTOR, VECTOR), **MAKING)
def as_leader(known, C, dt, moved, v_F):
    """Mean (N,) and covariance (N, N) of the components that are published, `dt` seconds after a summary
    with mean `known` and covariance C, in which we move by `moved` (3,) m, in n, and then at v_F (3,) m/s."""
    x, P = np.zeros(N), np.zeros((N, N))
    J, JC = np.empty((N, N)), np.zeros((N, N))
    a = _derivatives(known, dt, J)
    width = JC.shape[1]
    for i in range(N):
        for k in range(N):
            x[i] += J[i, k] * known[k]
            if J[i, k] != 0.0:
                for j in range(width):
                    JC[i, j] += J[i, k] * C[k, j]
    for i in range(3):
        x[i] -= moved[i]
        x[VX + i] -= v_F[i]
    x[SIZE] = J[SIZE, LOG_SIZE]
    x[A_LAT], x[A_LONG], x[A_ALONG] = a
    for i in range(N):
        for j in range(i + 1):
            for k in range(N):
                P[i, j] += JC[i, k] * J[j, k]
            P[j, i] = P[i, j]
    return x, P

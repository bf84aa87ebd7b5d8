"""Prediction of what an image shows of a body whose heading is known.

A view is rows. Each is one coordinate, right or down on the plane tangent to the sphere of directions at the
measured center (`image.measurement`), of one point of the body, or of two with a share each: a wing is the right
wingtip less the left one, the width of a box its right side less its left one. A side of a box is that of
whichever point reaches farthest.

The body banks as its thrust demands, and a multirotor pitches with it. All rows have one linearisation, and one
update. The state is that of `motion`, of which an image has at most one bias. What is open of the pitch, and by
how much a detector misplaces a point, is noise.
"""

from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.compiled import BOOL, FILLING, INT, MAKING, OUT, VECTOR, kernel, out, record
from onboard.estimators.leader import assumptions as given
from onboard.estimators.leader.hypotheses.gaussian import correct, dot, normalised_squared, project
from onboard.estimators.leader.hypotheses.motion import (
    AX,
    AY,
    AZ,
    BANK_ERROR,
    COURSE_LOCKED,
    COVARIANCES,
    HEADINGS,
    LOG_SIZE,
    NUMBER,
    RX,
    RY,
    RZ,
    TILT_EAST,
    TILT_NORTH,
    VX,
    VY,
    WING_SCALE_ERROR,
    G,
    course_of,
)
from onboard.estimators.leader.image.measurement import LOWEST, Rows, measured_spread


class ImageRows(NamedTuple):
    """Rows of an image (`image.measurement.Rows`).

    Which points of the body (m, 2), with which shares (m, 2), along which axis (m,); what is measured (m,), and
    its noise (m, m); whether they are of a wing; how the body pitches as it accelerates,
    the standard deviations of its pitch, rad, and of a point's place, as a share of the wingspan. From where, r_FC
    (3,) m, and about which axes (3, 3) in n; the column of the bias of the size, 0 without one; and which headings
    are course-locked (K,)."""

    points: Array
    of: Array
    shares: Array
    axis: Array
    y: Array
    R: Array
    is_wing: bool
    tilts: float
    pitch: float
    place_sigma: float
    r_FC: Array
    axes: Array
    bias: int
    course_locked: Array


class Scratch(NamedTuple):
    """Room for the body axes (3, 3), the derivatives of bank and pitch by the forces (2, 3), of each point its
    place, its two coordinates and its distance (k, 6); and the derivatives (m, W), an innovation (m,), a
    covariance (m, m), and a change of the state (W,)."""

    body: Array
    by: Array
    q: Array
    J: Array
    e: Array
    S: Array
    dx: Array


class Expectation(NamedTuple):
    """Prediction of a view by each particle.

    Mean (K, m), covariance with the state (K, m, W) and with itself (K, m, m), without noise, and the derivatives
    by the pitch (K, m)."""

    y: Array
    C: Array
    S: Array
    by_pitch: Array


IMAGE_ROWS: Final = record(
    ImageRows,
    *(OUT, out(INT), OUT, out(INT, 1), HEADINGS, OUT, BOOL),
    *(NUMBER, NUMBER, NUMBER, HEADINGS, OUT, INT, HEADINGS),
)
EXPECTATION: Final = record(Expectation, OUT, COVARIANCES, COVARIANCES, OUT)


def view_of(rows: Rows, camera: tuple[Array, Array, Array], course_locked: Array, bias: int = 0) -> ImageRows:
    """The view of rows by a `camera`.

    Its attitude R_cn (3, 3), its place r_FC_n (3,) m, and the measured axes (3, 3) in c."""
    R_cn, r_FC, measured = camera
    body = rows.points, rows.of, rows.shares, rows.axis, rows.y, rows.R
    kind = rows.is_wing, *rows.posture
    return ImageRows(*body, *kind, r_FC, measured @ R_cn, bias, course_locked)


def spread(rows: Rows, headings: Array, axes: Array) -> Array:
    """Return the spread (k,) of the rows' coordinates, root of the sum of squares, of a leader of wingspan 1 at
    distance 1 that flies level with these headings (k,), without perspective; `axes` (3, 3) in n."""
    c, s, zero, one = np.cos(headings), np.sin(headings), np.zeros_like(headings), np.ones_like(headings)
    body = np.array([[c, -s, zero], [s, c, zero], [zero, zero, one]])  # (3, 3, k)
    seen = np.einsum("ai,ijk,pj->kap", axes[1:], body, rows.points)  # (k, 2, points)
    ends = np.concatenate([seen, seen.max(axis=2, keepdims=True), seen.min(axis=2, keepdims=True)], axis=2)
    columns = ends[:, rows.axis[:, None], rows.of]  # HIGHEST and LOWEST count from the end
    return measured_spread(rows, np.sum(rows.shares * columns, axis=2))


@kernel(**FILLING)
def _posture(x, heading, tilts, B, by):
    """Body axes into B (3, 3), forward, right and down as columns, and the derivatives of bank and pitch by the
    forces: `by` (2, 3), by the acceleration north and east, and down. That of the bank by the heading, and sine
    and cosine of the bank."""
    c, s = np.cos(heading), np.sin(heading)
    north, east, weight = x[AX] + x[TILT_NORTH], x[AY] + x[TILT_EAST], G - x[AZ]
    across, along = east * c - north * s, north * c + east * s
    bank, pitch = np.arctan2(across, weight) + x[BANK_ERROR], 0.0
    square = across * across + weight * weight
    by[0, 0], by[0, 1], by[0, 2] = -s * weight / square, c * weight / square, across / square
    turned = -along * weight / square
    by[1] = 0.0
    if tilts > 0.0:
        pitch = tilts * np.arctan2(-along, weight)
        square = along * along + weight * weight
        by[1, 0], by[1, 1] = -tilts * c * weight / square, -tilts * s * weight / square
        by[1, 2] = -tilts * along / square
    sb, cb, sp, cp = np.sin(bank), np.cos(bank), np.sin(pitch), np.cos(pitch)
    B[0, 0], B[1, 0], B[2, 0] = c * cp, s * cp, -sp
    B[0, 1], B[1, 1], B[2, 1] = c * sp * sb - s * cb, s * sp * sb + c * cb, cp * sb
    B[0, 2], B[1, 2], B[2, 2] = c * sp * cb + s * sb, s * sp * cb - c * sb, cp * cb
    return turned, sb, cb


@kernel(**FILLING)
def _select_point(q, axis, number):
    """The point of a row: that of this number, or the one with the least or the largest coordinate."""
    if number >= 0:
        return number
    best = 0
    for other in range(q.shape[0]):
        if (q[other, 3 + axis] < q[best, 3 + axis]) == (number == LOWEST):
            best = other
    return best


@kernel(**FILLING)
def _project(x, size, view, B, q):
    """The places, coordinates and distances of all points, into q (k, 6).

    A distance is along the first axis, plus that of the straight line."""
    points, axes = view.points, view.axes
    for k in range(points.shape[0]):
        for i in range(3):
            offset = B[i, 0] * points[k, 0] + B[i, 1] * points[k, 1] + B[i, 2] * points[k, 2]
            q[k, i] = x[i] - view.r_FC[i] + size * offset
        length = np.sqrt(q[k, 0] ** 2 + q[k, 1] ** 2 + q[k, 2] ** 2)
        below = length + axes[0, 0] * q[k, 0] + axes[0, 1] * q[k, 1] + axes[0, 2] * q[k, 2]
        q[k, 5] = max(below, 1e-9 * length)
        for a in range(2):
            e = axes[1 + a]
            q[k, 3 + a] = 2.0 * (e[0] * q[k, 0] + e[1] * q[k, 1] + e[2] * q[k, 2]) / q[k, 5]


@kernel(**FILLING)
def _derivatives(point, size, q, axes, a, share, B, sb, cb, J):
    """Return the derivatives of a share of a coordinate, of a point of the body.

    Along the axis a, seen at q (6,): by the place, added to J; by bank, pitch, heading, and the logarithm of the
    size."""
    banked, pitched, turned, grown = 0.0, 0.0, 0.0, 0.0
    length = np.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2)
    twice, seen = 2.0 * share / q[5], q[3 + a]
    px, py, pz = size * point[0], size * point[1], size * point[2]
    north = px * B[0, 0] + py * B[0, 1] + pz * B[0, 2]
    east = px * B[1, 0] + py * B[1, 1] + pz * B[1, 2]
    for i in range(3):
        gradient = twice * (axes[1 + a, i] - 0.5 * seen * (q[i] / length + axes[0, i]))
        J[i] += gradient
        grown += gradient * (px * B[i, 0] + py * B[i, 1] + pz * B[i, 2])
        banked += gradient * (py * B[i, 2] - pz * B[i, 1])
        # the forward axis turns up; right and down turn by it as far as the leader is banked
        up = -B[i, 2] * cb - B[i, 1] * sb
        pitched += gradient * (px * up + (py * sb + pz * cb) * B[i, 0])
        turned += gradient * (-east, north, 0.0)[i]
    return banked, pitched, turned, grown


@kernel(**FILLING)
def _linearised(x, heading, is_course_locked, view, scratch, h, J, d):
    """The rows that are expected into h (m,), their derivatives by the state into J (m, W), by the pitch into d
    (m,)."""
    B, by, q = scratch.body, scratch.by, scratch.q
    bank_turned, sb, cb = _posture(x, heading, view.tilts, B, by)
    bias = view.bias
    scale = x[LOG_SIZE] + (x[WING_SCALE_ERROR] if view.is_wing else 0.0)
    size = np.exp(scale + (x[bias] if bias > 0 else 0.0))
    _project(x, size, view, B, q)
    speed2 = x[VX] * x[VX] + x[VY] * x[VY] + given.MIN_SPEED_SQUARED
    J[:] = 0.0
    for j in range(h.shape[0]):
        a, row = view.axis[j], J[j]
        h[j] = 0.0
        banked, pitched, turned, grown = 0.0, 0.0, 0.0, 0.0
        for side in range(2):
            share = view.shares[j, side]
            if share != 0.0:
                k = _select_point(q, a, view.of[j, side])
                h[j] += share * q[k, 3 + a]
                more = _derivatives(view.points[k], size, q[k], view.axes, a, share, B, sb, cb, row)
                banked, pitched = banked + more[0], pitched + more[1]
                turned, grown = turned + more[2], grown + more[3]
        if view.is_wing:
            if j > 1:  # its length by the first order, and its middle by the second
                grown = h[j] if j < 4 else 2.0 * (h[j] - h[j - 4])
            row[WING_SCALE_ERROR] = grown
        d[j], row[BANK_ERROR], row[LOG_SIZE] = pitched, banked, grown
        if bias > 0:
            row[bias] = grown
        row[TILT_NORTH] = banked * by[0, 0] + pitched * by[1, 0]
        row[TILT_EAST] = banked * by[0, 1] + pitched * by[1, 1]
        row[AX], row[AY], row[AZ] = row[TILT_NORTH], row[TILT_EAST], banked * by[0, 2] + pitched * by[1, 2]
        if is_course_locked and view.is_wing:
            aside = turned + banked * bank_turned
            row[VX], row[VY] = -aside * x[VY] / speed2, aside * x[VX] / speed2
            row[AX] += given.COURSE_LEAD_TIME_S * row[VX]  # an acceleration turns the course
            row[AY] += given.COURSE_LEAD_TIME_S * row[VY]


@kernel(**FILLING)
def _expected(x, P, heading, is_course_locked, view, scratch, each):
    """Predict a view by one particle, into `each` (`Expectation`)."""
    h, C, S, d = each
    J = scratch.J
    _linearised(x, heading, is_course_locked, view, scratch, h, J, d)
    for i in range(h.shape[0]):
        project(J[i], P, view.bias, C[i])
        for j in range(i + 1):
            S[i, j] = S[j, i] = dot(J[j], C[i], view.bias)


@kernel(**MAKING)
def _scratch(view, width):
    m, k = view.y.shape[0], view.points.shape[0]
    of_body = np.empty((3, 3)), np.empty((2, 3)), np.empty((k, 6))
    return Scratch(*of_body, np.empty((m, width)), np.empty(m), np.empty((m, m)), np.empty(width))


@kernel(**FILLING)
def _noise(view, x, d, own, expected, S):
    """Add noise to what is `expected` (m, m), into S (m, m).

    So many times the rows' `own`, that of the points' places, and that of the pitch, which is common."""
    place, pitch2 = view.place_sigma * np.exp(x[LOG_SIZE]), view.pitch * view.pitch
    place2 = place * place / (x[RX] * x[RX] + x[RY] * x[RY] + x[RZ] * x[RZ])
    for i in range(d.shape[0]):
        for j in range(d.shape[0]):
            S[i, j] = expected[i, j] + own * view.R[i, j] + pitch2 * d[i] * d[j]
        S[i, i] += place2 * (view.shares[i, 0] ** 2 + view.shares[i, 1] ** 2)


@kernel(**FILLING)
def _tip_order(view, h):
    """-1 where wingtips are expected in the other order than measured: detectors name tips by their side."""
    return -1.0 if view.is_wing and h[2] * view.y[2] + h[3] * view.y[3] < 0 else 1.0


@kernel(**MAKING)
def _expectation(means, view):
    count, m = means.shape[0], view.y.shape[0]
    return Expectation(
        np.empty((count, m)), np.empty((count, m, means.shape[1])), np.empty((count, m, m)), np.empty((count, m))
    )


@kernel(**FILLING)
def _accumulate(k, means, P, headings, w, view, scratch, expected, mean, S):
    """Add what a particle expects to the mean (m,) and the second moments S (m, m) of all."""
    h, d = expected.y[k], expected.by_pitch[k]
    _expected(
        *(means[k], P[k], headings[k], view.course_locked[k] == COURSE_LOCKED, view, scratch),
        (h, expected.C[k], expected.S[k], d),
    )
    m, side, both = h.shape[0], _tip_order(view, h), scratch.S
    _noise(view, means[k], d, 0.0, expected.S[k], both)
    for i in range(m):
        sign = w[k] * (side if 2 <= i < 4 else 1.0)
        mean[i] += sign * h[i]
        for j in range(m):
            S[i, j] += sign * (side if 2 <= j < 4 else 1.0) * (h[i] * h[j] + both[i, j])


@kernel((OUT, COVARIANCES, HEADINGS, VECTOR, IMAGE_ROWS), **MAKING)
def expect(means, P, headings, w, view):
    """Predict a view by all particles of weights w (K,).

    Mean (m,), innovation (m,), its covariance (m, m) and NIS, with each particle's wingtips in the order of those
    measured, and the measured ones in that of the mean; and what each of them expects."""
    m, expected, scratch = view.y.shape[0], _expectation(means, view), _scratch(view, P.shape[2])
    mean, e, S = np.zeros(m), np.empty(m), np.zeros((m, m))
    for k in range(means.shape[0]):
        _accumulate(k, means, P, headings, w, view, scratch, expected, mean, S)
    side = _tip_order(view, mean)
    for i in range(m):
        e[i] = (side if 2 <= i < 4 else 1.0) * view.y[i] - mean[i]
        for j in range(m):
            S[i, j] += view.R[i, j] - mean[i] * mean[j]
    scratch.S[:], scratch.e[:] = S, e
    return mean, e, S, normalised_squared(scratch.e, scratch.S), expected


@kernel(**FILLING)
def _squared_error(view, x, heading, scratch, h, d):
    """Return the squared error of a view, in units of its noise, for a particle with that heading."""
    e, R = scratch.e, scratch.S
    _linearised(x, heading, False, view, scratch, h, scratch.J, d)
    R[:] = 0.0
    _noise(view, x, d, 1.0, R, R)
    for i in range(h.shape[0]):
        e[i] = view.y[i] - h[i]
    return normalised_squared(e, R)


@kernel((OUT, COVARIANCES, HEADINGS, IMAGE_ROWS), **MAKING)
def orient(means, P, headings, view):
    """Predict named points by each particle.

    One whose nose is where they show the tail turns round, in place."""
    expected, scratch = _expectation(means, view), _scratch(view, P.shape[2])
    for k in range(means.shape[0]):
        x, each = means[k], (expected.y[k], expected.C[k], expected.S[k], expected.by_pitch[k])
        same = _squared_error(view, x, headings[k], scratch, each[0], each[3])
        x[BANK_ERROR] = -x[BANK_ERROR]  # the other way round, it banks to the other side
        if _squared_error(view, x, headings[k] + np.pi, scratch, each[0], each[3]) < same:
            headings[k] += np.pi
            for i in range(P.shape[2]):
                P[k, BANK_ERROR, i] = -P[k, BANK_ERROR, i]
                P[k, i, BANK_ERROR] = -P[k, i, BANK_ERROR]
        else:
            x[BANK_ERROR] = -x[BANK_ERROR]
        _expected(x, P[k], headings[k], False, view, scratch, each)
    return expected


@kernel(**FILLING)
def _use_log_length(right, down, h, variance, e, C, S):
    """A wing's innovation and covariances, in place, by the logarithm of its length and by its angle, in which a
    range is linear: a line through lengths draws it to the near side. A wing that hardly shows stays as it is."""
    seen2, expected2 = right * right + down * down, h[2] * h[2] + h[3] * h[3]
    least2 = given.MIN_WING_SIGMAS_SQUARED * variance
    if seen2 < least2 or expected2 < least2:
        return
    a, b = (right * h[2] + down * h[3]) / expected2, (down * h[2] - right * h[3]) / expected2
    if a < abs(b):
        return
    length, angle = 0.5 * np.log(a * a + b * b), np.arctan2(b, a)
    e[2], e[3] = right * length - down * angle, right * angle + down * length
    for j in range(C.shape[1]):
        C[2, j], C[3, j] = a * C[2, j] - b * C[3, j], a * C[3, j] + b * C[2, j]
    for j in range(S.shape[1]):
        S[2, j], S[3, j] = a * S[2, j] - b * S[3, j], a * S[3, j] + b * S[2, j]
    for i in range(S.shape[0]):
        S[i, 2], S[i, 3] = a * S[i, 2] - b * S[i, 3], a * S[i, 3] + b * S[i, 2]


@kernel(**FILLING)
def _update(k, means, P, headings, view, scratch, expected):
    """See `update`: NIS and logarithm of the likelihood of one particle."""
    x, h, e, C, S, dx = means[k], expected.y[k], scratch.e, scratch.J, scratch.S, scratch.dx
    m, side = h.shape[0], _tip_order(view, h)
    for i in range(m):
        e[i] = (side if 2 <= i < 4 else 1.0) * view.y[i] - h[i]
        for j in range(m):
            S[i, j] = expected.S[k, i, j]
        for j in range(C.shape[1]):
            C[i, j] = expected.C[k, i, j]
    if view.is_wing:
        _use_log_length(side * view.y[2], side * view.y[3], h, view.R[2, 2], e, C, S)
    _noise(view, x, expected.by_pitch[k], 1.0, S, S)
    aside = headings[k] - course_of(x)
    r0, r1, r2 = x[RX], x[RY], x[RZ]
    nis, log_det = correct(x, P[k], e, C, S, dx)
    if view.is_wing:  # a range changes by a factor, as its logarithm does
        square = r0 * r0 + r1 * r1 + r2 * r2
        step = (r0 * dx[RX] + r1 * dx[RY] + r2 * dx[RZ]) / square
        more = np.exp(min(step, 1.0)) - 1.0 - step
        x[RX] += more * r0
        x[RY] += more * r1
        x[RZ] += more * r2
        if view.course_locked[k] == COURSE_LOCKED:
            headings[k] = course_of(x) + aside
    # by Student's t in place of a Gaussian (Roth, Ozkan and Gustafsson, 2013): one image that fits no
    # hypothesis decides little between them
    return nis, -0.5 * ((given.STUDENT_T_DOF + m) * np.log1p(nis / given.STUDENT_T_DOF) + log_det)


@kernel((OUT, COVARIANCES, HEADINGS, IMAGE_ROWS, EXPECTATION), **MAKING)
def update(means, P, headings, view, expected):
    """NIS (K,) and logarithms of the likelihoods (K,), without their common constant, of a view of which the same
    particles `expected` this. Means (K, W), covariances (K, W, W) and tied headings are corrected in place."""
    count = means.shape[0]
    nis, log_l, scratch = np.empty(count), np.empty(count), _scratch(view, P.shape[2])
    for k in range(count):
        nis[k], log_l[k] = _update(k, means, P, headings, view, scratch, expected)
    return nis, log_l

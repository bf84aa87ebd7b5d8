"""Updates of particles by images, poses, reports and ranges: means and weights.

An image shows center and wing, and may show a shape, or a pose. Points and boxes show the range of a leader of
some size; a pose alone shows the range itself. Each of them has an error that lasts, which no number of images
reduces: it is a part of each particle's state.

The rotation of a planar marker has a known ambiguity: its mirror image about the line of sight looks nearly alike.
So a heading is where it was measured with most of the probability, and else at the mirror image, as of a marker
that stands across the forward axis, or anywhere.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader import assumptions as given
from onboard.estimators.leader.assumptions import LeaderModel
from onboard.estimators.leader.hypotheses import motion as model
from onboard.estimators.leader.hypotheses import view
from onboard.estimators.leader.hypotheses.auxiliary import Auxiliary
from onboard.estimators.leader.hypotheses.motion import BANK_ERROR, COURSE_LOCKED, FREE, MOTION, POSITION
from onboard.estimators.leader.hypotheses.particles import (
    Bias,
    Particles,
    evidence,
    fitting,
    seen_together,
    weighted,
)
from onboard.estimators.leader.hypotheses.prediction import particles_of, passed, weigh
from onboard.estimators.leader.image.camera_pose import CameraPose
from onboard.estimators.leader.image.measurement import Measurement, Rows
from onboard.estimators.leader.image.pose import PoseFeatures
from onboard.filters.belief import Belief, FilterError
from onboard.filters.gating import chi_square_threshold

BOXES: Final = "boxes"  # the names of biases
POSES: Final = "poses"
# as `edge_on_visibility`: of a leader whose range is measured, noise depends little on its heading
ANY_HEADING: Final = 1.0


class Expected(NamedTuple):
    """Particles, with the bias that an image has, and what they expect together of the image's view: mean (m,),
    innovation (m,), its covariance (m, m) and NIS; and what each particle expects."""

    particles: Particles
    view: view.ImageRows
    y: Array
    innovation: Array
    S: Array
    nis: float
    each: view.Expectation


def expect(particles: Particles, seen: Measurement, pose: CameraPose) -> Expected:
    """Predict the rows by which an image is judged. Raises FilterError."""
    particles, rows = with_rows(particles, seen.rows, seen.axes, pose)
    w = np.exp(particles.log_weights)
    expected = view.expect(particles.means, particles.covariances, particles.headings, w, rows)
    found = Expected(particles, rows, *expected)
    if not math.isfinite(found.nis):
        raise FilterError("the particles have lost their numbers")
    return found


def log_likelihood(expected: Expected) -> float:
    """The logarithm of the likelihood of an image of which particles `expected` this, without its constant."""
    particles, shown, each = expected.particles, expected.view, expected.each
    headings, means, P = particles.headings.copy(), particles.means.copy(), particles.covariances.copy()
    _, log_l = view.update(means, P, headings, shown, each)
    return float(np.logaddexp.reduce(particles.log_weights + log_l))


def with_rows(particles: Particles, rows: Rows, axes: Array, pose: CameraPose) -> tuple[Particles, view.ImageRows]:
    """The particles with the rows' bias, if they have one, and the rows as they see them about these axes (3, 3)
    in c."""
    column = 0
    if rows.bias is not None:
        particles = particles.with_biases(Bias(BOXES, rows.bias))
        column = particles.column(BOXES)
    camera = pose.R_cn, pose.r_FC_n, axes
    return particles, view.view_of(rows, camera, particles.course_locked, column)


def update(
    settings: LeaderModel,
    particles: Particles,
    seen: Measurement,
    pose: CameraPose,
    expected: Expected | None = None,
) -> tuple[Particles, float]:
    """Update all particles with one image.

    The posterior, and the NIS that MIN_WEIGHT_IN_GATE of their weight have at most; of a box MIN_SHAPE_WEIGHT, as
    only the right headings expect one. If that exceeds the gate, the particles are returned as they were. What an
    image shows beyond these rows has a gate of its own. `expected`: what they expect of the image, where that is
    known. Raises FilterError."""
    rows, before, is_box = seen.rows, particles, seen.rows.bias is not None
    expected = expected or expect(particles, seen, pose)
    particles, shown, each = expected.particles, expected.view, expected.each
    if seen.is_metric and seen.pose is not None:
        particles = particles._replace(edge_on_visibility=ANY_HEADING, metric=True)
    elif rows.is_wing or seen.further is not None:
        particles = particles._replace(edge_on_visibility=given.MIN_VISIBLE_FRACTION, metric=False)
    headings, means, P = particles.headings.copy(), particles.means.copy(), particles.covariances.copy()
    nis, log_l = view.update(means, P, headings, shown, each)
    least = at_most(particles, nis, given.MIN_SHAPE_WEIGHT if is_box else given.MIN_WEIGHT_IN_GATE)
    if least > settings.gate + (given.SHAPE_GATE_NIS_PER_ROW * len(rows.y) if is_box else 0.0):
        return before, least
    after = particles._replace(headings=headings, means=means, covariances=P, misfits=())
    w = np.exp(particles.log_weights)
    off, change = seen_together(w, nis, particles.means, pose.v_F_n, settings.gate)
    if is_box:
        least = 0.0
    else:
        after = after._replace(mean_nis=_averaged_nis(particles, off / len(rows.y)))
    if seen.further is not None:
        fit = fitted(settings, after, seen.further, seen.axes, pose)
        if fit.particles is not None:
            after, log_l = fit.particles._replace(heading_observed=True), log_l + fit.log_l
            after = after._replace(keypoint_bias=max(particles.keypoint_bias, seen.keypoint_bias))
        after = after._replace(misfits=fit.misfits)
    if seen.pose is not None:
        found, pose_nis, more = posed(after, seen.pose, pose)
        beyond = at_most(after, pose_nis, given.MIN_SHAPE_WEIGHT)
        if beyond <= settings.gate:
            after, log_l = found, log_l + more
        elif seen.is_metric:
            return before, beyond
    # The faster the view of the leader changes, the more does an image count; while the view stays the same, so do
    # the errors of what each particle supposes. Images that fit no particle count less for each of them.
    seconds = max(particles.unseen, given.MIN_EVIDENCE_INTERVAL_S)
    rate = settings.steady_evidence + change / settings.new_view
    rate += particles.startup_evidence / given.STARTUP_TIME_S
    believed = min(min(rate, settings.evidence_rate) * seconds, 1.0) * min(1.0, 1.0 / particles.mean_nis)
    new = -math.expm1(-particles.unseen / settings.rolled_time)
    mean_bank_error = after.mean_bank_error + new * (after.means[:, BANK_ERROR] - after.mean_bank_error)
    startup_evidence = particles.startup_evidence * math.exp(-seconds / given.STARTUP_TIME_S)
    after = after._replace(mean_bank_error=mean_bank_error, unseen=0.0, startup_evidence=startup_evidence)
    both = particles_of(particles), particles_of(after)
    log_weights = weigh(*both, particles.log_weights, log_l, believed, passed(settings, particles))
    return fitting(settings, after._replace(log_weights=log_weights)), least


def assist(settings: LeaderModel, particles: Particles, taken: Auxiliary, *, is_open: bool) -> Particles | None:
    """The particles after what is measured beside the images; None where too few particles expected it: of
    particles whose range `is_open`, the right ones are few. Raises FilterError."""
    known = particles.with_biases(*taken.biases)
    rows = taken.rows(known)
    found, nis, log_l = corrected(known, *rows)
    limit = chi_square_threshold(given.REPORT_GATE_PROBABILITY, rows.innovations.shape[1])
    least = at_most(known, nis, given.MIN_SHAPE_WEIGHT if is_open else given.MIN_WEIGHT_IN_GATE)
    if least > limit:
        return None
    # One that fits ends a large NIS of images, which would else last as long as none come; one that does not has
    # this gate, and its errors last longer than the NIS is averaged over.
    mean_nis = min(particles.mean_nis, _averaged_nis(particles, least / rows.innovations.shape[1]))
    found = found._replace(mean_nis=mean_nis)
    believed = min(settings.evidence_rate * given.REPORT_EVIDENCE_TIME_S, 1.0)
    return fitting(settings, weighted(found, evidence(log_l, believed)))


def _averaged_nis(particles: Particles, off: float) -> float:
    """The mean NIS per component after a measurement whose own is `off`."""
    off = min(off, given.MAX_IMAGE_NIS)
    return off + math.exp(-particles.unseen / given.MEAN_NIS_TIME_S) * (particles.mean_nis - off)


class ShapeFit(NamedTuple):
    """The particles after what an image shows of a shape, None if that fits no heading, with the particles'
    logarithms of likelihoods (K,), the NIS that MIN_SHAPE_WEIGHT of the weight have at most, and the named points
    that fit none."""

    particles: Particles | None
    log_l: Array
    beyond: float
    misfits: tuple[str, ...] = ()


def fitted(settings: LeaderModel, particles: Particles, points: Rows, axes: Array, pose: CameraPose) -> ShapeFit:
    """The particles after named points.

    If all of them fit no heading, those that fit none by themselves are left out: one point that a detector finds
    elsewhere costs the others nothing. Raises FilterError."""

    def fit(which: Sequence[int]) -> ShapeFit:
        at = [2 * k + axis for k in which for axis in (0, 1)]
        rows = points._replace(y=points.y[at], R=points.R[np.ix_(at, at)], of=points.of[at])
        rows = rows._replace(shares=points.shares[at], axis=points.axis[at])
        _, shown = with_rows(particles, rows, axes, pose)
        headings, means, P = particles.headings.copy(), particles.means.copy(), particles.covariances.copy()
        each = view.orient(means, P, headings, shown)
        nis, log_l = view.update(means, P, headings, shown, each)
        beyond = at_most(particles, nis, given.MIN_SHAPE_WEIGHT)
        if beyond > settings.gate + given.SHAPE_GATE_NIS_PER_ROW * len(rows.y):
            return ShapeFit(None, log_l, beyond)
        locked = _still_locked(particles, headings)
        after = particles._replace(headings=headings, means=means, covariances=P, course_locked=locked)
        return ShapeFit(after, log_l, beyond)

    every = range(len(points.names))
    whole = fit(every)
    if whole.particles is not None:
        return whole
    fit_alone = [k for k in every if fit([k]).particles is not None]
    misfits = tuple(points.names[k] for k in every if k not in fit_alone)
    rest = fit(fit_alone) if misfits and fit_alone else whole
    return rest._replace(misfits=misfits)


def at_most(particles: Particles, nis: Array, share: float) -> float:
    """The NIS that a share of the weight has at most. Raises FilterError."""
    order = nis.argsort()
    least = float(nis[order[np.exp(particles.log_weights[order]).cumsum().searchsorted(share)]])
    if not math.isfinite(least):
        raise FilterError("the particles have lost their numbers")
    return least


def informed(settings: LeaderModel, particles: Particles, prior: Belief, *, flew: bool) -> Particles | None:
    """The particles with what was believed of position and velocity before, (6,) and (6, 6), in n; None where less
    than MIN_SHAPE_WEIGHT of its weight agrees: only the right headings do. If it `flew`, few hypotheses say that
    it hovers: a velocity that may have changed meanwhile does not contradict them enough. Raises FilterError."""
    H = np.eye(particles.means.shape[1])[MOTION]
    found, nis, log_l = corrected(particles, H, prior.mean - particles.means[:, MOTION], prior.covariance)
    if at_most(particles, nis, given.MIN_SHAPE_WEIGHT) > settings.gate:
        return None
    after = weighted(found, evidence(log_l, 1.0))
    hovers = after.regimes == model.HOVERING
    share = float(np.exp(after.log_weights[hovers]).sum())
    stopped = 1.0 / settings.flies_for  # as of one that was slow for a second meanwhile
    if not flew or not stopped < share < 1.0:
        return after
    to_fewer = math.log(stopped / share), math.log((1.0 - stopped) / (1.0 - share))
    return after._replace(log_weights=after.log_weights + np.where(hovers, *to_fewer))


def corrected(
    particles: Particles, H: Array, innovations: Array, R_y: Array, considered: Sequence[int] = ()
) -> tuple[Particles, Array, Array]:
    """The particles after rows with derivatives H (m, W) or (K, m, W), innovations (K, m) and noise R_y (m, m),
    with each particle's NIS (K,) and logarithm of the likelihood (K,), without their common constant. The
    components that are `considered` stay as they are. Tied headings turn with their courses.

    Raises FilterError."""
    HP = H @ particles.covariances
    S = HP @ np.swapaxes(H, -1, -2) + R_y
    try:
        gain = np.linalg.solve(S, HP).transpose(0, 2, 1)
        off = np.linalg.solve(S, innovations[:, :, None])[:, :, 0]
    except np.linalg.LinAlgError as error:
        raise FilterError("the innovation's covariance is singular") from error
    nis = np.einsum("ki,ki->k", innovations, off)
    at = list(considered)
    gain[:, at] = 0.0
    means = particles.means + np.einsum("kij,kj->ki", gain, innovations)
    P = particles.covariances - gain @ HP
    P[:, at] = P[:, :, at].transpose(0, 2, 1)
    log_l = -0.5 * (nis + np.linalg.slogdet(S)[1])
    turned = model.courses(means) - model.courses(particles.means)
    headings = particles.headings + np.where(particles.course_locked == COURSE_LOCKED, turned, 0.0)
    P = 0.5 * (P + P.transpose(0, 2, 1))
    return particles._replace(headings=headings, means=means, covariances=P), nis, log_l


def of_ranges(shows: PoseFeatures) -> Bias:
    """Return the bias of the ranges of poses, in the logarithm."""
    return Bias(POSES, shows.range_bias)


def posed(particles: Particles, shows: PoseFeatures, camera: CameraPose) -> tuple[Particles, Array, Array]:
    """The particles after a pose, with each particle's NIS and log likelihood."""
    nis, log_l, heading = *np.zeros((2, len(particles.headings))), shows.heading(camera)
    if shows.range_ is not None:
        particles = particles.with_biases(of_ranges(shows))
        bias = particles.column(POSES)
        off = particles.means[:, POSITION] - camera.r_FC_n
        distance = np.linalg.norm(off, axis=1)
        appears = distance * np.exp(particles.means[:, bias])
        H = np.zeros((len(off), 1, particles.means.shape[1]))
        H[:, 0, POSITION], H[:, 0, bias] = off * (appears / distance**2)[:, None], appears
        noise = np.array([[shows.range_sigma**2]])
        particles, nis, log_l = corrected(particles, H, (shows.range_ - appears)[:, None], noise)
    headings, means, P = particles.headings.copy(), particles.means.copy(), particles.covariances.copy()
    if heading is not None:
        log_l = log_l + measure_heading(headings, means, P, *heading)
        keypoint_bias = max(particles.keypoint_bias, given.MARKER_HEADING_BIAS)
        particles = particles._replace(heading_observed=True, keypoint_bias=keypoint_bias)
    locked = _still_locked(particles, headings)
    after = particles._replace(headings=headings, means=means, covariances=P, course_locked=locked)
    return after, nis, log_l


def _still_locked(particles: Particles, headings: Array) -> Array:
    """Which headings (K,) are still locked to their courses.

    Not those that were measured elsewhere."""
    return np.where(
        headings == particles.headings, particles.course_locked, np.minimum(particles.course_locked, FREE)
    )


def measure_heading(
    headings: Array, means: Array, P: Array, heading: float, mirrored: float, sigma: float
) -> Array:
    """Return the log-likelihoods (K,) of a heading that was measured, or of its mirror image.

    Headings (K,), means (K, N) and covariances (K, N, N) of particles that have it the wrong way round are turned
    in place: they bank to the other side."""
    likely, turned = (_likelihood(headings + way, heading, mirrored, sigma) for way in (0.0, math.pi))
    turns = turned > likely
    headings[turns] += math.pi
    means[turns, BANK_ERROR] *= -1.0
    P[turns, BANK_ERROR, :] *= -1.0
    P[turns, :, BANK_ERROR] *= -1.0
    return np.asarray(np.log(np.maximum(likely, turned)))


def _likelihood(headings: Array, heading: float, mirrored: float, sigma: float) -> Array:
    found = np.full(len(headings), given.STRAY_POSE_PROBABILITY / (2.0 * math.pi))
    for share, at in (
        (1.0 - given.MIRRORED_POSE_PROBABILITY - given.STRAY_POSE_PROBABILITY, heading),
        (given.MIRRORED_POSE_PROBABILITY, mirrored),
    ):
        off = (headings - at + math.pi) % (2.0 * math.pi) - math.pi
        found += share * np.exp(-0.5 * (off / sigma) ** 2) / (math.sqrt(2.0 * math.pi) * sigma)
    return found

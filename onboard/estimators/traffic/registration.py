"""Registration: estimation of the error of our own attitude from anchors.

Anchors are aircraft with both an echo and a report. The attitude error rotates everything that our radar measures.
One Kalman filter estimates the rotation, the error of our own position, and for each anchor the steady error
(bias) of its reports and the noise of its newest one: states [rotation (3), own (3), then bias (3) and noise (3)
of each]. An anchor's position by radar minus its reported one = rotation x r_RT_n + own - bias - noise + the
radar's noise.

The filter is separate from the tracks. The radar's attitude is corrected by the rotation, and each track's filter
has only the remaining error (`residual`), as if that were its own. If tracks shared one belief in the rotation,
each would treat their common initial error as news from the others, and all would drift together, more certain
with every scan.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.traffic.config import Config
from onboard.estimators.traffic.reports import Report
from onboard.filters import kalman
from onboard.filters.association import Places
from onboard.filters.belief import Belief, FilterError
from onboard.filters.gating import chi_square_threshold, normalised_squared
from onboard.geometry.rotations import matrix_from_quaternion, quaternion_from_vector
from onboard.models.intruder.attitude_error import AttitudeErrorModel
from onboard.models.intruder.measurement import cross_matrix, position
from onboard.units import NS_PER_S

MAX_ANCHORS: Final = 12  # Twice as many would improve the rotation by a third, and take eight times as long.
ROTATION, OWN = slice(0, 3), slice(3, 6)
COMMON_STATES: Final = 6  # rotation and own position
ANCHOR_STATES: Final = 6  # bias and noise of each anchor
MIN_VARIANCE_IMPROVEMENT_RATIO: Final = 2.0  # In any direction; then the tracks are corrected.
MIN_ATTITUDE_PRIOR_SIGMA: Final = 1e-8  # rad; keeps the covariance invertible
AVERAGING_TIME_S: Final = 2.0  # over which tracks average echoes, approximately
MIN_ELEVATION_COSINE: Final = 0.01  # Nearer the vertical, azimuth is undefined.


class AnchorEcho(NamedTuple):
    """An anchor in a scan.

    Attributes
    ----------
    number
        Number of its track.
    by_radar
        r_OT_n (3,) by the radar.
    by_report
        r_OT_n (3,) by its last `report`, predicted by its track since then.
    noise
        Noise (3, 3) of their difference, without the report's.
    """

    number: int
    by_radar: Array
    by_report: Array
    noise: Array
    report: Report


class Anchor(NamedTuple):
    """An anchor's newest report, and the times of its newest and newest fused echo."""

    report: Report
    echo_ns: int
    fused_ns: int | None


class Registration:
    """The `rotation` and the model of its error.

    The error consists of `residual`, the bias, and a jitter that is independent in each scan. The noise of a
    report affects the rotation for a second or two: while the report is the newest, and after that through the
    states corrected by it. Tracks average scans and do not model this, so its mean remainder counts as jitter. Its
    covariance is computed separately (`_noise`, a part of the belief's), and so is its covariance with the sum of
    the rotation's errors in the last scans (`_past`).
    """

    def __init__(self, config: Config) -> None:
        c = config
        known = np.radians([c.own_tilt_sigma_deg, c.own_tilt_sigma_deg, c.own_yaw_sigma_deg])
        attitude = np.maximum(known, MIN_ATTITUDE_PRIOR_SIGMA)
        self._prior = AttitudeErrorModel(np.diag(attitude), np.ones(3), np.full(3, c.own_attitude_time_s))
        self._sigma = np.concatenate([attitude, np.full(3, c.own_position_sigma_m)])
        self._time = np.repeat([c.own_attitude_time_s, c.own_position_time_s], 3)
        self._bias_time, self._forget_ns = c.report_bias_time_s, round(c.coast_after_s * NS_PER_S)
        self._gate = chi_square_threshold(c.gate_probability, 3)
        self.clear()

    def clear(self) -> None:
        """Return to the configured errors of our attitude and position, without anchors."""
        self._t_ns: int | None = None
        self._anchors: dict[int, Anchor] = {}  # by track numbers, in the order of their states
        self._belief = Belief(np.zeros(COMMON_STATES), np.diag(self._sigma**2))
        self._noise, self._past = np.zeros((COMMON_STATES, COMMON_STATES)), np.zeros((COMMON_STATES, 3))
        self._anchor_sigma = np.zeros(0)  # of the anchors' states before any measurement
        self.residual = self._prior
        self._jitter = np.zeros((3, 3))
        # covariances of the rotation: of the tracks' belief, before the last prediction, and of its noise
        self._in_tracks = self._before = self._moved = self.residual.covariance

    @property
    def rotation(self) -> Array:
        """The rotation (3,) of everything that the radar measures, rad about n's axes."""
        mean: Array = self._belief.mean
        return mean[ROTATION]

    def echo_jitter(self, polar: Array, R_rn: Array) -> Array:
        """Return the standard deviations (k, 3) that the jitter adds to echoes (k, 3).

        They are of range (0), azimuth and elevation. The radar has attitude R_rn (3, 3).
        """
        toward = position(polar * [0.0, 1.0, 1.0] + [1.0, 0.0, 0.0], np.zeros(3), R_rn)
        level = np.maximum(np.cos(polar[:, 2]), MIN_ELEVATION_COSINE)[:, None]
        # a rotation w moves the direction by w x toward: along `aside` that is azimuth, across it elevation
        aside = np.cross(R_rn[2], toward) / level
        sigma = np.zeros_like(polar)
        for at, axes in ((1, np.cross(toward, aside) / level), (2, aside)):
            sigma[:, at] = np.sqrt(np.maximum(np.sum((axes @ self._jitter) * axes, axis=1), 0.0))
        return sigma

    def covariance_with_bias(self, numbers: Sequence[int], bias_sigma: Array) -> Array:
        """Return `ReportErrors.attitude_covariance` (k, 3, 3) of tracks with these numbers.

        `bias_sigma` (k, 3) are the standard deviations of their reports' steady errors.
        """
        shared = np.zeros((len(numbers), 3, 3))
        if self.residual is not self._prior:
            P, rows = self._belief.covariance, {number: row for row, number in enumerate(numbers)}
            for at, number in enumerate(self._anchors):
                if number in rows:
                    first = COMMON_STATES + ANCHOR_STATES * at
                    off = P[ROTATION, first : first + 3] - P[ROTATION, OWN]  # relative to our own position
                    shared[rows[number]] = off / bias_sigma[rows[number]]
        return shared

    def corrected(self, R_rn: Array) -> Array:
        """Return the attitude R_rn (3, 3) of a radar, corrected by the rotation."""
        return np.ascontiguousarray(R_rn @ matrix_from_quaternion(quaternion_from_vector(self.rotation)))

    def update(self, t_ns: int, echoes: Sequence[AnchorEcho], r_OR_n: Array) -> Belief | None:
        """Fuse the anchors of a scan, at the time of `advance`, with a radar at r_OR_n (3,).

        Returns the attitude error of the tracks, (3,) and (3, 3), if the rotation has improved enough to correct
        them.
        """
        before, predicted = self.rotation, self._belief.covariance[ROTATION, ROTATION]
        self._update_anchors(t_ns, echoes)
        self._fuse(t_ns, [e for e in echoes if e.number in self._anchors], r_OR_n)
        self._past += self._noise[:, ROTATION]
        since_ns = t_ns - self._forget_ns
        if not any(a.fused_ns is not None and a.fused_ns >= since_ns for a in self._anchors.values()):
            self.residual, self._jitter = self._prior, np.zeros((3, 3))
            self._in_tracks = self._belief.covariance[ROTATION, ROTATION]
            return None
        bias, self._jitter = self._bias_and_jitter()
        self.residual = self._residual_model(bias)
        if np.linalg.eigvals(np.linalg.solve(bias, self._in_tracks)).real.max() < MIN_VARIANCE_IMPROVEMENT_RATIO:
            return None
        self._in_tracks = bias
        # Only the share that existed before: the rest of the change is motion since the last scan.
        share = self._before @ np.linalg.inv(predicted)
        return Belief(share @ (self.rotation - before), bias)

    def advance(self, t_ns: int) -> None:
        """Predict to a time, never back."""
        dt = 0.0 if self._t_ns is None else max((t_ns - self._t_ns) / NS_PER_S, 0.0)
        self._t_ns = t_ns if self._t_ns is None else max(t_ns, self._t_ns)
        times = np.tile(np.repeat([self._bias_time, np.inf], 3), len(self._anchors))
        decay = np.exp(-dt / np.concatenate([self._time, times]))
        sigma = np.concatenate([self._sigma, self._anchor_sigma])
        mean, P = self._belief
        self._before = P[ROTATION, ROTATION]
        more = np.diag(sigma**2 * (1.0 - decay**2))
        self._moved = more[ROTATION, ROTATION]
        self._belief = Belief(decay * mean, P * np.outer(decay, decay) + more)
        self._noise = self._noise * np.outer(decay, decay)
        self._past = np.exp(-dt / AVERAGING_TIME_S) * decay[:, None] * self._past

    def _update_anchors(self, t_ns: int, echoes: Sequence[AnchorEcho]) -> None:
        """Remove, renew and append anchors.

        Anchors without a recent echo are removed, the noise states of new reports are replaced, and new anchors
        are appended while there is room.
        """
        last = {e.number: e.report for e in echoes}
        since_ns = t_ns - self._forget_ns
        for number in [k for k, a in self._anchors.items() if a.echo_ns < since_ns and k not in last]:
            self._remove(list(self._anchors).index(number))
            del self._anchors[number]
        mean, P = (array.copy() for array in self._belief)
        for at, (number, anchor) in enumerate(self._anchors.items()):
            report = last.get(number)
            if report is None:
                continue
            if report is not anchor.report:
                noise = slice(COMMON_STATES + ANCHOR_STATES * at + 3, COMMON_STATES + ANCHOR_STATES * (at + 1))
                mean[noise], P[noise, :], P[:, noise] = 0.0, 0.0, 0.0
                P[noise, noise] = report.R[:3, :3]
                self._noise[noise, :], self._noise[:, noise], self._past[noise] = 0.0, 0.0, 0.0
                self._noise[noise, noise] = report.R[:3, :3]
            self._anchors[number] = Anchor(report, t_ns, anchor.fused_ns)
        self._belief = Belief(mean, P)
        for echo in sorted(echoes, key=lambda e: float(np.linalg.norm(e.report.bias_sigma))):
            if echo.number not in self._anchors and len(self._anchors) < MAX_ANCHORS:
                self._anchors[echo.number] = Anchor(echo.report, t_ns, None)
                self._append(echo.report)

    def _append(self, report: Report) -> None:
        mean, P = self._belief
        n = len(mean)
        wider, noise = np.pad(P, (0, ANCHOR_STATES)), np.pad(self._noise, (0, ANCHOR_STATES))
        # steady errors are relative to our own position, whose error has a state already
        bias = np.sqrt(np.maximum(report.bias_sigma**2 - self._sigma[OWN] ** 2, (0.5 * report.bias_sigma) ** 2))
        wider[n : n + 3, n : n + 3] = np.diag(bias**2)
        wider[n + 3 :, n + 3 :] = noise[n + 3 :, n + 3 :] = report.R[:3, :3]
        self._belief, self._noise = Belief(np.pad(mean, (0, ANCHOR_STATES)), wider), noise
        self._past = np.pad(self._past, ((0, ANCHOR_STATES), (0, 0)))
        self._anchor_sigma = np.concatenate([self._anchor_sigma, bias, np.zeros(3)])

    def _remove(self, at: int) -> None:
        first = COMMON_STATES + ANCHOR_STATES * at
        kept = np.delete(np.arange(len(self._belief.mean)), np.arange(first, first + ANCHOR_STATES))
        square = np.ix_(kept, kept)
        self._belief = Belief(self._belief.mean[kept], self._belief.covariance[square])
        self._noise, self._past = self._noise[square], self._past[kept]
        self._anchor_sigma = self._anchor_sigma[kept[COMMON_STATES:] - COMMON_STATES]

    def _fuse(self, t_ns: int, echoes: Sequence[AnchorEcho], r_OR_n: Array) -> None:
        """Correct by the echoes of consistent anchors."""
        if not echoes:
            return
        places = {number: at for at, number in enumerate(self._anchors)}
        size, count = len(self._belief.mean), len(echoes)
        H, y, R = np.zeros((count, 3, size)), np.zeros((count, 3)), np.zeros((count, 3, 3))
        for k, echo in enumerate(echoes):
            at = COMMON_STATES + ANCHOR_STATES * places[echo.number]
            y[k] = echo.by_radar - echo.by_report
            H[k, :, ROTATION] = -cross_matrix(echo.by_report - r_OR_n)
            H[k, :, OWN] = np.eye(3)
            H[k, :, at : at + 3] = H[k, :, at + 3 : at + 6] = -np.eye(3)
            R[k] = echo.noise
        fits = self._select_consistent(y, H, R)
        if not len(fits):
            return
        try:
            wide = H[fits].reshape(-1, size)
            update = kalman.update(self._belief, y[fits].ravel(), wide, _blocks(R[fits]))
        except FilterError:
            self.clear()
            return
        gain = np.linalg.solve(update.innovation_covariance, wide @ self._belief.covariance).T
        left = np.eye(size) - gain @ wide
        self._noise, self._past = left @ self._noise @ left.T, left @ self._past
        self._belief = update.belief
        for number in (echoes[k].number for k in fits.tolist()):
            self._anchors[number] = self._anchors[number]._replace(fused_ns=t_ns)

    def _select_consistent(self, y: Array, H: Array, R: Array) -> Places:
        """Return which of k anchors are consistent with the belief and with each other.

        While the rotation is unknown, an anchor with a false position seems possible by itself, but not with
        others. The worst is left out first.
        """
        fits = np.arange(len(y))
        while len(fits):
            wide = H[fits].reshape(-1, H.shape[2])
            S = wide @ self._belief.covariance @ wide.T + _blocks(R[fits])
            inverse = np.linalg.inv(S)
            pulls = (inverse @ (y[fits].ravel() - wide @ self._belief.mean)).reshape(-1, 3)
            own = inverse.reshape(len(fits), 3, len(fits), 3)[range(len(fits)), :, range(len(fits))]
            beside = normalised_squared(pulls, own)  # of each innovation, given the others
            if beside.max() <= self._gate:
                break
            fits = np.delete(fits, int(np.argmax(beside)))
        return fits

    def _residual_model(self, bias: Array) -> AttitudeErrorModel:
        """Return the model of a residual with that covariance (3, 3).

        It changes as slowly as the anchors' steady errors, but as fast as our own attitude's error in directions
        that the anchors do not determine; between them, by the ratio of standard deviations.
        """
        scale = np.diag(self._prior.axes)
        share, axes = np.linalg.eigh(bias / np.outer(scale, scale))
        share = np.clip(share, 0.0, 1.0)
        left = np.sqrt(share)
        rate = (1.0 - left) / self._bias_time + left / self._prior.times
        return AttitudeErrorModel(scale[:, None] * axes, share, 1.0 / rate)

    def _bias_and_jitter(self) -> tuple[Array, Array]:
        """Return the covariances (3, 3) of the rotation's bias, and of the rest.

        The rest is treated as independent in each scan.
        """
        P, noise = self._belief.covariance, self._noise[ROTATION, ROTATION]
        sizes = np.concatenate([self._sigma[OWN], self._anchor_sigma])
        slow = np.flatnonzero(sizes)  # our own position, and the reports' steady errors
        by_slow = P[ROTATION, 3 + slow] / sizes[slow]
        by_them = by_slow @ by_slow.T
        # The rest is due to the radar's noise and to the rotation's motion. A scan that removes as much as has
        # been added since the last one leaves little of it in directions that it determines, and all in others.
        other = P[ROTATION, ROTATION] - by_them - noise
        kept = P[ROTATION, ROTATION] @ np.linalg.inv(P[ROTATION, ROTATION] + self._moved)
        old = kept @ other @ kept.T
        jitter = other - old + self._past[ROTATION] + self._past[ROTATION].T - noise
        return by_them + old + MIN_ATTITUDE_PRIOR_SIGMA**2 * np.eye(3), jitter


def _blocks(matrices: Array) -> Array:
    """Return the block diagonal matrix (3k, 3k) of (k, 3, 3)."""
    count = len(matrices)
    wide = np.zeros((count, 3, count, 3))
    wide[range(count), :, range(count)] = matrices
    return wide.reshape(3 * count, 3 * count)

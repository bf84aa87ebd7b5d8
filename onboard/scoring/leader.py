"""Accuracy of the leader's estimate against a truth: errors and consistency.

Valid estimates count from `settle` seconds after the start of the truth, together with the share of time that had
one. The NIS is white, so its mean has chi-square bounds for the number of images; the NEES is correlated
throughout a flight, so its bounds are those of a single draw.
"""

import math
from array import array
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters.gating import chi_square_threshold, mean_bounds, normalised_squared
from onboard.messages import Estimate, MeasurementReport, Record, Verdict
from onboard.scoring.reference import Reference
from onboard.scoring.statistics import availability, percent, rms, single_bounds
from onboard.units import S_PER_NS

LEADER_SETTLING_TIME_S: Final = 15.0
DIVERGENCE_WINDOW_S: Final = 5.0  # end of the flight over which divergence is decided
MIN_WRONG_SIGMAS, MIN_WRONG_FRACTION = 3.0, 0.05  # A range error above both is confidently wrong.
SAMPLE_INTERVAL_S: Final = 0.1  # of availability, without a truth
MIN_REBOOT_STEP_S: Final = 5.0  # A larger step back in time means a rebooted clock.
MAX_TRUTH_INTERVAL_S: Final = 0.5


class LeaderScore(Record, frozen=True, kw_only=True):
    """Score of the leader's estimates.

    Errors are RMS over the `scored` estimates; None without a truth.

    Attributes
    ----------
    valid_percent
        Share of the time after `settle_s` with a valid estimate.
    confidently_wrong_percent
        Share of scored estimates whose range is off by more than three of its sigmas and more than 5 %.
    """

    estimates: int
    valid: int
    scored: int
    settle_s: float
    valid_percent: float | None
    confidently_wrong_percent: float | None
    range_error_rms_percent: float | None
    position_rmse_m: float | None
    velocity_rmse_m_s: float | None
    size_error_rms_percent: float | None
    nees_mean: float | None
    nees_dof: int
    nees_bounds: tuple[float, float] | None
    inside_95_percent: float | None
    nis_mean: float | None
    nis_dof: int
    nis_bounds: tuple[float, float] | None
    images_scored: int
    diverged: bool
    resets: int
    verdicts: dict[str, int]


class Errors(NamedTuple):
    """Errors of n estimates.

    Attributes
    ----------
    time
        s, (n,).
    position, velocity
        Norms (n,), m and m/s.
    range_fraction, size_fraction
        Errors as fractions of the true range and size.
    range_sigmas
        Errors of the range over their standard deviations.
    bearing_deg
        Errors of the bearing.
    nees, position_nees
        NEES of all components, and of the position.
    dof
        Degrees of freedom of `nees`.
    """

    time: Array
    position: Array
    velocity: Array
    range_fraction: Array
    size_fraction: Array
    range_sigmas: Array
    bearing_deg: Array
    nees: Array
    position_nees: Array
    dof: int


def score_leader(
    estimates: Iterable[Estimate], reference: Reference | None, settle: float = LEADER_SETTLING_TIME_S
) -> LeaderScore:
    """Return the score of one flight's estimates of one target.

    Without a reference, it has only the figures that need none.
    """
    scorer = LeaderScorer(reference, settle)
    for estimate in estimates:
        scorer.add(estimate)
    return scorer.score()


class LeaderScorer:
    """Score of estimates that are added one by one, in order.

    It keeps errors only, since an hour of estimates would be gigabytes. Errors are computed for `piece` estimates
    at a time.
    """

    def __init__(
        self, reference: Reference | None, settle: float = LEADER_SETTLING_TIME_S, piece: int = 4096
    ) -> None:
        self._reference, self._settle, self._piece = reference, settle, piece
        self._begin: float | None = None
        self._shift = 0.0  # s, the boot clock's step back at a reboot
        self._valid: list[Estimate] = []  # waiting for their errors to be computed
        self._errors: list[Errors] = []
        self._times, self._is_valid = array("d"), array("b")  # of all estimates
        self._nis: list[float] = []
        self._dof = 0
        self._resets = 0
        self._counts = Counter({"estimates": 0, "valid": 0})
        self._verdicts: Counter[str] = Counter()

    def add(self, estimate: Estimate) -> None:
        """Add the next estimate."""
        if self._begin is None:
            reference = self._reference
            known = reference is not None and len(reference.time)
            start = reference.time[0] if reference is not None and known else estimate.t_ns * S_PER_NS
            self._begin = float(start) + self._settle
        t = estimate.t_ns * S_PER_NS + self._shift
        if self._reference is None and self._times and t < self._times[-1] - MIN_REBOOT_STEP_S:
            self._shift += self._times[-1] - t
            t = self._times[-1]
        self._counts["estimates"] += 1
        self._resets = estimate.reset_count
        self._add_image(estimate.measurement, self._begin)
        is_valid = estimate.valid and estimate.mean is not None and estimate.covariance is not None
        self._times.append(t)
        self._is_valid.append(is_valid)
        if not is_valid:
            return
        self._counts["valid"] += 1
        if self._reference is not None:
            self._valid.append(estimate)
            if len(self._valid) >= self._piece:
                self._compute()

    def score(self, end: float = math.inf) -> LeaderScore:
        """Return the score of all estimates added. The truth counts until the flight's `end`, s."""
        self._compute()
        reference, dof, n = self._reference, self._dof, len(self._nis)
        all_errors = _joined(self._errors)
        errors = _since(all_errors, self._begin or 0.0)
        samples = self._samples()
        samples = samples[samples <= end + self._shift]
        available = availability(samples, self._times, self._is_valid)
        return LeaderScore(
            estimates=self._counts["estimates"],
            valid=self._counts["valid"],
            scored=len(errors.time) if errors else 0,
            settle_s=self._settle,
            valid_percent=percent(available[samples >= (self._begin or 0.0)]),
            confidently_wrong_percent=percent(_is_wrong(errors)) if errors else None,
            range_error_rms_percent=rms(errors.range_fraction * 100) if errors else None,
            position_rmse_m=rms(errors.position) if errors else None,
            velocity_rmse_m_s=rms(errors.velocity) if errors else None,
            size_error_rms_percent=rms(errors.size_fraction * 100) if errors else None,
            nees_mean=float(errors.nees.mean()) if errors else None,
            nees_dof=errors.dof if errors else 0,
            nees_bounds=single_bounds(errors.dof) if errors else None,
            inside_95_percent=percent(errors.position_nees < chi_square_threshold(0.95, 3)) if errors else None,
            nis_mean=float(np.mean(self._nis)) if n else None,
            nis_dof=dof,
            nis_bounds=mean_bounds(dof, n) if n else None,
            images_scored=n,
            diverged=_diverged(all_errors, samples, available) if reference is not None else False,
            resets=self._resets,
            verdicts=dict(self._verdicts),
        )

    def errors(self) -> Errors | None:
        """Return the errors of all valid estimates that have a truth; None without any."""
        self._compute()
        return _joined(self._errors)

    def _samples(self) -> Array:
        """Return times (n,), s, at which an estimate is expected.

        They are those of the truth, otherwise they cover the whole flight.
        """
        if self._reference is not None:
            return self._reference.time
        return np.arange(self._times[0], self._times[-1], SAMPLE_INTERVAL_S) if self._times else np.empty(0)

    def _add_image(self, image: MeasurementReport | None, begin: float) -> None:
        if image is None:
            return
        self._dof = self._dof or len(image.components)
        self._verdicts[image.verdict] += 1
        fused = image.verdict in {Verdict.FUSED, Verdict.FUSED_LATE}
        if fused and image.nis is not None and image.t_ns * S_PER_NS + self._shift >= begin:
            self._nis.append(image.nis)

    def _compute(self) -> None:
        errors = _errors(self._valid, self._reference) if self._reference is not None else None
        if errors is not None:
            self._errors.append(errors)
        self._valid.clear()


def _joined(pieces: list[Errors]) -> Errors | None:
    """Concatenate errors; None without any."""
    if not pieces:
        return None
    arrays = [np.concatenate(parts) for parts in zip(*(piece[:-1] for piece in pieces), strict=True)]
    return Errors(*arrays, pieces[0].dof)  # type: ignore[call-arg, arg-type]  # the last field is not an array


def _since(errors: Errors | None, begin: float) -> Errors | None:
    """Return the errors from a time on; None if there are none."""
    if errors is None or not (errors.time >= begin).any():
        return None
    later = errors.time >= begin
    arrays = {name: values[later] for name, values in errors._asdict().items() if name != "dof"}
    return errors._replace(**arrays)


def _errors(valid: Sequence[Estimate], reference: Reference) -> Errors | None:
    """Return errors against the truth, interpolated at each estimate's time.

    None if none can be compared.
    """
    times = np.array([e.t_ns * S_PER_NS for e in valid])
    if not len(times) or not len(reference.time):
        return None
    after = np.clip(np.searchsorted(reference.time, times), 1, max(len(reference.time) - 1, 1))
    gap = reference.time[after] - reference.time[after - 1]
    inside = (times >= reference.time[0]) & (times <= reference.time[-1]) & (gap < MAX_TRUTH_INTERVAL_S)
    if not inside.any():
        return None
    chosen = [e for e, use in zip(valid, inside, strict=True) if use]
    columns = [chosen[0].components.index(c) for c in reference.components]
    mean = np.array([e.mean for e in chosen])[:, columns]
    P = np.array([e.covariance for e in chosen])[:, columns][:, :, columns]
    truth = np.column_stack([np.interp(times[inside], reference.time, v) for v in reference.values.T])
    error = mean - truth
    r, size = slice(0, 3), reference.components.index("size")
    distance = np.linalg.norm(truth[:, r], axis=1)
    estimated = np.linalg.norm(mean[:, r], axis=1)
    direction = mean[:, r] / estimated[:, None]
    sigma = np.sqrt(np.einsum("ni,nij,nj->n", direction, P[:, r, r], direction))
    cosine = np.sum(mean[:, r] * truth[:, r], axis=1) / (distance * estimated)
    return Errors(
        time=times[inside],
        position=np.linalg.norm(error[:, r], axis=1),
        velocity=np.linalg.norm(error[:, 3:6], axis=1),
        range_fraction=estimated / distance - 1,
        size_fraction=error[:, size] / truth[:, size],
        range_sigmas=np.abs(estimated - distance) / sigma,
        bearing_deg=np.degrees(np.arccos(np.clip(cosine, -1, 1))),
        nees=normalised_squared(error, P),
        position_nees=normalised_squared(error[:, r], P[:, r, r]),
        dof=len(columns),
    )


def _is_wrong(errors: Errors) -> Array:
    """Return whether each estimate is confidently wrong (n,)."""
    wrong = (errors.range_sigmas > MIN_WRONG_SIGMAS) & (np.abs(errors.range_fraction) > MIN_WRONG_FRACTION)
    return np.asarray(wrong)


def _diverged(errors: Errors | None, samples: Array, available: Array) -> bool:
    """Return whether the estimates had diverged by the end of the flight.

    Over the last seconds, valid estimates were missing for more than half of the time, or their mean range error
    exceeded 50 %, or their mean bearing error 5 degrees.
    """
    if errors is None:
        return True
    begin = samples[-1] - DIVERGENCE_WINDOW_S
    last = errors.time > begin
    if not last.any() or np.mean(available[samples > begin]) < 0.5:
        return True
    return bool(np.mean(np.abs(errors.range_fraction[last])) > 0.5 or np.mean(errors.bearing_deg[last]) > 5.0)

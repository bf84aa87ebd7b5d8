"""Accuracy of our own state against a simulator's truth: errors, and whether the covariance fits them."""

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters.gating import normalised_squared
from onboard.messages import NavState, Quaternion, Record, Truth
from onboard.messages.between import nav_state_at
from onboard.scoring.statistics import availability, percent, rms, single_bounds
from onboard.units import NS_PER_S, S_PER_NS

SETTLE: Final = 10.0  # s after the first state
DOF: Final = 6
SCORED: Final = slice(3, 3 + DOF)  # velocity and attitude; the positions have different origins


class OwnStateScore(Record, frozen=True, kw_only=True):
    """RMS of the errors' norms over valid states from `settle_s` after the first; None without truth.
    `valid_percent`: share of that time in which there was a valid state. `nees_mean`: of velocity and attitude
    together; its bounds are those of a single draw, since the errors of one flight are one draw. `faults`: the
    faults that the states reported, each "kind part at s" on the boot clock."""

    states: int
    valid: int
    settle_s: float
    valid_percent: float | None
    velocity_rmse_m_s: float | None
    attitude_rmse_deg: float | None
    inside_3_sigma_percent: float | None
    nees_mean: float | None
    nees_dof: int
    nees_bounds: tuple[float, float] | None
    nis_ratio: float | None
    resets: int
    faults: tuple[str, ...]


class _Error(NamedTuple):
    """Errors of one state: velocity (3,) m/s, NED; norm of the attitude error, rad; whether each velocity axis is
    within 3 sigmas; NEES of both together."""

    velocity: Array
    angle: float
    inside: list[bool]
    nees: float


def score_own_state(
    states: Sequence[NavState], truths: Sequence[Truth], settle: float = SETTLE
) -> OwnStateScore | None:
    """The score of one flight's states; None without states."""
    if not states:
        return None
    faults = {(f.t_onset_ns, f.name) for s in states for f in s.faults}
    ratios = [s.nis_ratio for s in states if s.nis_ratio is not None]
    begin_ns = states[0].t_ns + round(settle * NS_PER_S)
    errors = list(_errors(states, truths, begin_ns))
    samples = np.array([t.t_ns * S_PER_NS for t in truths if t.t_ns >= begin_ns])
    available = availability(samples, [s.t_ns * S_PER_NS for s in states], [s.valid for s in states])
    return OwnStateScore(
        states=len(states),
        valid=sum(s.valid for s in states),
        settle_s=settle,
        valid_percent=percent(available),
        velocity_rmse_m_s=rms([float(np.linalg.norm(e.velocity)) for e in errors]),
        attitude_rmse_deg=rms(np.degrees([e.angle for e in errors])),
        inside_3_sigma_percent=percent([inside for e in errors for inside in e.inside]),
        nees_mean=float(np.mean([e.nees for e in errors])) if errors else None,
        nees_dof=DOF if errors else 0,
        nees_bounds=single_bounds(DOF) if errors else None,
        nis_ratio=float(np.mean(ratios)) if ratios else None,
        resets=states[-1].reset_count,
        faults=tuple(f"{name} at {t * 1e-9:.2f} s" for t, name in sorted(faults)),
    )


def _errors(states: Sequence[NavState], truths: Sequence[Truth], begin_ns: int) -> Iterator[_Error]:
    """The error at each truth with valid states around it, from begin_ns on."""
    valid = [s for s in states if s.valid and s.t_ns >= begin_ns]
    for truth in truths:
        s = nav_state_at(valid, truth.t_ns)
        if s is None or s.mean is None or s.covariance is None or s.q_nb is None:
            continue
        velocity = np.subtract(truth.v_F_n, s.mean[3:6])
        P = np.array(s.covariance)
        yield _Error(
            velocity,
            2 * float(np.arccos(min(abs(float(np.dot(truth.q_nF, s.q_nb))), 1.0))),
            (np.abs(velocity) < 3 * np.sqrt(np.diag(P)[3:6])).tolist(),
            float(normalised_squared(np.concatenate([velocity, _turn(s.q_nb, truth.q_nF)]), P[SCORED, SCORED])),
        )


def _turn(q_nb: Quaternion, q_true: Quaternion) -> Array:
    """The rotation vector (3,) rad, about b's axes, from an attitude to the true one."""
    (w, *v), (w_true, *v_true) = q_nb, q_true
    axis = w * np.array(v_true) - w_true * np.array(v) - np.cross(v, v_true)
    sine, cosine = float(np.linalg.norm(axis)), float(np.dot(q_nb, q_true))
    scale = 2.0 if sine < 1e-8 else 2.0 * np.arctan2(sine, abs(cosine)) / sine  # which tends to 2
    return np.asarray(np.copysign(scale, cosine) * axis)

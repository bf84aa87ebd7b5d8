"""Accuracy of our own state against a simulator's truth: errors and consistency."""

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters.gating import normalised_squared
from onboard.messages import NavState, Quaternion, Record, Truth
from onboard.messages.between import nav_state_at
from onboard.scoring.statistics import availability, percent, rms, single_bounds
from onboard.units import NS_PER_S, S_PER_NS

OWN_STATE_SETTLING_TIME_S: Final = 10.0  # after the first state
SCORED_DOF: Final = 6
SCORED_COMPONENTS: Final = slice(3, 3 + SCORED_DOF)  # velocity and attitude; the positions have different origins


class OwnStateScore(Record, frozen=True, kw_only=True):
    """Score of our own state: RMS of the errors' norms over valid states; None without truth.

    Attributes
    ----------
    settle_s
        Time from the first state to the first scored one.
    valid_percent
        Share of the scored time with a valid state.
    nees_mean
        NEES of velocity and attitude together. Its bounds are those of a single draw, since the errors of one
        flight are one draw.
    faults
        Reported faults, each "kind part at s" on the boot clock.
    """

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
    """Errors of one state.

    Attributes
    ----------
    velocity
        Error (3,) in NED, m/s.
    angle
        Norm of the attitude error, rad.
    inside
        Whether each velocity axis is within 3 sigmas.
    nees
        NEES of velocity and attitude.
    """

    velocity: Array
    angle: float
    inside: list[bool]
    nees: float


def score_own_state(
    states: Sequence[NavState], truths: Sequence[Truth], settle: float = OWN_STATE_SETTLING_TIME_S
) -> OwnStateScore | None:
    """Return the score of one flight's states; None without states."""
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
        nees_dof=SCORED_DOF if errors else 0,
        nees_bounds=single_bounds(SCORED_DOF) if errors else None,
        nis_ratio=float(np.mean(ratios)) if ratios else None,
        resets=states[-1].reset_count,
        faults=tuple(f"{name} at {t * 1e-9:.2f} s" for t, name in sorted(faults)),
    )


def _errors(states: Sequence[NavState], truths: Sequence[Truth], begin_ns: int) -> Iterator[_Error]:
    """Yield the error at each truth with valid states around it, from begin_ns on."""
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
            float(
                normalised_squared(
                    np.concatenate([velocity, _turn(s.q_nb, truth.q_nF)]), P[SCORED_COMPONENTS, SCORED_COMPONENTS]
                )
            ),
        )


def _turn(q_nb: Quaternion, q_true: Quaternion) -> Array:
    """Return the rotation vector (3,), rad, about b's axes, from an attitude to the true one."""
    (w, *v), (w_true, *v_true) = q_nb, q_true
    axis = w * np.array(v_true) - w_true * np.array(v) - np.cross(v, v_true)
    sine, cosine = float(np.linalg.norm(axis)), float(np.dot(q_nb, q_true))
    scale = 2.0 if sine < 1e-8 else 2.0 * np.arctan2(sine, abs(cosine)) / sine  # The limit is 2.
    return np.asarray(np.copysign(scale, cosine) * axis)

"""How good the estimate of our own state was, against a simulator's truth."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from onboard.messages import NavState, Record, Truth

SETTLE: Final = 10.0  # s after the first state
NEAREST_NS: Final = 6_000_000  # of a state to a truth: stamps are whole milliseconds, steps of the world 5


class OwnScore(Record, frozen=True, kw_only=True):
    """RMS of the errors' norms over valid states from `settle_s` after the first; None where there was no truth.
    `faults` are those that were named, each "kind part at s" on the boot clock."""

    states: int
    valid: int
    settle_s: float
    velocity_rmse_m_s: float | None
    attitude_rmse_deg: float | None
    inside_3_sigma_percent: float | None
    nis_ratio: float | None
    resets: int
    faults: tuple[str, ...]


def score_own(states: Sequence[NavState], truths: Sequence[Truth], settle: float = SETTLE) -> OwnScore | None:
    """The score of one flight's states; None when there are none."""
    if not states:
        return None
    named = {(f.t_onset_ns, f.kind, f.part) for s in states for f in s.faults}
    ratios = [s.nis_ratio for s in states if s.nis_ratio is not None]
    velocity, angle, inside = _errors(states, truths, states[0].t_ns + round(settle * 1e9))
    return OwnScore(
        states=len(states),
        valid=sum(s.valid for s in states),
        settle_s=settle,
        velocity_rmse_m_s=_rms(velocity),
        attitude_rmse_deg=_rms(np.degrees(angle)),
        inside_3_sigma_percent=float(100 * np.mean(inside)) if len(inside) else None,
        nis_ratio=float(np.mean(ratios)) if ratios else None,
        resets=states[-1].reset_count,
        faults=tuple(f"{f'{kind} {part}'.strip()} at {t * 1e-9:.2f} s" for t, kind, part in sorted(named)),
    )


def _errors(
    states: Sequence[NavState], truths: Sequence[Truth], begin_ns: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of each truth with a state near it: the velocity's error (m/s), the attitude's (rad), and for each axis of
    the velocity whether it is within 3 sigmas."""
    told = [s for s in states if s.valid and s.t_ns >= begin_ns]
    times = np.array([s.t_ns for s in told])
    velocity, angle, inside = [], [], []
    for truth in truths if told else ():
        i = int(np.argmin(np.abs(times - truth.t_ns)))
        s = told[i]
        if abs(s.t_ns - truth.t_ns) > NEAREST_NS or s.mean is None or s.covariance is None or s.q_nb is None:
            continue
        error = np.subtract(truth.v_F_n, s.mean[3:6])
        velocity.append(np.linalg.norm(error))
        inside += (np.abs(error) < 3 * np.sqrt(np.diag(np.array(s.covariance))[3:6])).tolist()
        angle.append(2 * np.arccos(min(abs(float(np.dot(truth.q_nF, s.q_nb))), 1.0)))
    return np.array(velocity), np.array(angle), np.array(inside)


def _rms(errors: np.ndarray) -> float | None:
    return float(np.sqrt(np.mean(np.square(errors)))) if len(errors) else None

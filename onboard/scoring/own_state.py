"""Accuracy of the estimate of our own state, against a simulator's truth."""

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from onboard.messages import NavState, Record, Truth
from onboard.scoring.statistics import availability, percent, rms

SETTLE: Final = 10.0  # s after the first state
NEAREST_NS: Final = 6_000_000  # of a state to a truth: stamps are whole milliseconds, steps of the world 5


class OwnStateScore(Record, frozen=True, kw_only=True):
    """RMS of the errors' norms over valid states from `settle_s` after the first; None without truth.
    `valid_percent`: share of that time in which there was a valid state. `faults`: the faults that the states
    reported, each "kind part at s" on the boot clock."""

    states: int
    valid: int
    settle_s: float
    valid_percent: float | None
    velocity_rmse_m_s: float | None
    attitude_rmse_deg: float | None
    inside_3_sigma_percent: float | None
    nis_ratio: float | None
    resets: int
    faults: tuple[str, ...]


class _Error(NamedTuple):
    """Of one state: norms of the velocity error (m/s) and of the attitude error (rad); for each axis of the
    velocity whether the error is within 3 sigmas."""

    velocity: float
    angle: float
    inside: list[bool]


def score_own_state(
    states: Sequence[NavState], truths: Sequence[Truth], settle: float = SETTLE
) -> OwnStateScore | None:
    """The score of one flight's states; None without states."""
    if not states:
        return None
    faults = {(f.t_onset_ns, f.kind, f.part) for s in states for f in s.faults}
    ratios = [s.nis_ratio for s in states if s.nis_ratio is not None]
    begin_ns = states[0].t_ns + round(settle * 1e9)
    errors = list(_errors(states, truths, begin_ns))
    samples = np.array([t.t_ns * 1e-9 for t in truths if t.t_ns >= begin_ns])
    available = availability(samples, [s.t_ns * 1e-9 for s in states], [s.valid for s in states])
    return OwnStateScore(
        states=len(states),
        valid=sum(s.valid for s in states),
        settle_s=settle,
        valid_percent=percent(available),
        velocity_rmse_m_s=rms([e.velocity for e in errors]),
        attitude_rmse_deg=rms(np.degrees([e.angle for e in errors])),
        inside_3_sigma_percent=percent([inside for e in errors for inside in e.inside]),
        nis_ratio=float(np.mean(ratios)) if ratios else None,
        resets=states[-1].reset_count,
        faults=tuple(f"{f'{kind} {part}'.strip()} at {t * 1e-9:.2f} s" for t, kind, part in sorted(faults)),
    )


def _errors(states: Sequence[NavState], truths: Sequence[Truth], begin_ns: int) -> Iterator[_Error]:
    """The error at each truth with a valid state near it, from begin_ns on."""
    valid = [s for s in states if s.valid and s.t_ns >= begin_ns]
    times = np.array([s.t_ns for s in valid])
    for truth in truths if valid else ():
        s = valid[int(np.argmin(np.abs(times - truth.t_ns)))]
        if abs(s.t_ns - truth.t_ns) > NEAREST_NS or s.mean is None or s.covariance is None or s.q_nb is None:
            continue
        error = np.subtract(truth.v_F_n, s.mean[3:6])
        yield _Error(
            float(np.linalg.norm(error)),
            2 * float(np.arccos(min(abs(float(np.dot(truth.q_nF, s.q_nb))), 1.0))),
            (np.abs(error) < 3 * np.sqrt(np.diag(np.array(s.covariance))[3:6])).tolist(),
        )

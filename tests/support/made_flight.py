"""A flight of 40 s made by hand: outputs, messages, health and truth, in which nothing is estimated.

What reports, tables and exports show of it changes with them alone. Every state, verdict and kind of gap occurs.
"""

import math
from collections.abc import Callable, Iterator
from typing import Any, Final

from onboard.analysis.flights.replay import ReplayResult
from onboard.config import Config
from onboard.geometry.rotations import quaternion_from_euler
from onboard.messages import (
    ActuatorOutputs,
    Battery,
    Cause,
    Estimate,
    Fault,
    FaultKind,
    GpsFix,
    Health,
    Heartbeat,
    Imu,
    Lifecycle,
    MeasurementReport,
    Message,
    Output,
    OwnPose,
    ParamValue,
    Refusal,
    StatusText,
    StreamHealth,
    Verdict,
)
from onboard.models import relative_motion
from onboard.pipeline import Pipeline
from tests.support.streams import EPOCH, TRUTH_COLUMNS
from tests.support.vehicle_records import nav_state

END_S: Final = 40.0
GAP_S: Final = (20.0, 23.5)  # no estimate of the leader
SECONDS_NS: Final = 1_000_000_000
REJECTED: Final = (Verdict.GATED, Verdict.OUT_OF_VIEW, Verdict.DUPLICATE)
FAULTS: Final = (
    Fault(kind=FaultKind.MOTOR, part="motor 2", t_onset_ns=18 * SECONDS_NS, magnitude=0.25, unit="of the thrust"),
    Fault(kind=FaultKind.MASS, part="", t_onset_ns=31 * SECONDS_NS, magnitude=1.4, unit="of the mass"),
)


def true_motion(t: float) -> tuple[float, ...]:
    """The leader's position and velocity relative to us, and its size."""
    return (25.0 + 0.2 * t, 6.0 * math.sin(0.2 * t), -2.0, 0.2, 1.2 * math.cos(0.2 * t), 0.0, 2.0)


def truth() -> str:
    """The truth as a table, without what the leader accelerates."""
    rows = [",".join(f"{value:.6f}" for value in (k / 10, *true_motion(k / 10))) for k in range(401)]
    return "\n".join([TRUTH_COLUMNS, *rows, ""])


def own_pose(t: float) -> OwnPose:
    """Our own motion; where we are is not known for a second."""
    north_east = (None, None) if t < 1.0 else (8.0 * t, 30.0 * math.sin(0.1 * t))
    q = quaternion_from_euler(0.2 * math.sin(t), -0.1, 0.3 + 0.01 * t)
    velocity = (8.0, 3.0 * math.cos(0.1 * t), -0.5)
    return OwnPose(
        t_ns=_ns(t), r_OF_n=(*north_east, -20.0 - 0.5 * t), v_F_n=velocity, a_F_n=(0, 0, 0), q_nb=tuple(q.tolist())
    )


def _ns(t: float) -> int:
    return round(t * 1e9)


def _state(t: float) -> Lifecycle:
    if t < 2.0:
        return Lifecycle.SEARCHING if t < 1.0 else Lifecycle.INITIALISING
    if GAP_S[0] <= t < GAP_S[1]:
        return Lifecycle.LOST
    return Lifecycle.COASTING if GAP_S[0] - 1.0 <= t < GAP_S[0] else Lifecycle.TRACKING


def _points(t: float) -> tuple[tuple[float, float], ...]:
    """Where a camera that looks north, level, sees the middle and both ends of a wing that lies east."""
    north, east, down, *_ = true_motion(t)
    return tuple(((east + side) / north, down / north) for side in (0.0, -1.0, 1.0))


def leader(k: int, name: str = "leader", offset: float = 0.02) -> Estimate:
    """The estimate after the k-th tenth of a second: `offset` too far of the distance, more and more."""
    t = k / 10
    state, fused = _state(t), k % 9 != 4
    verdict = Verdict.INITIALISING if t < 2.0 else Verdict.FUSED if fused else REJECTED[k // 9 % 3]
    mean = [value * (1.0 + offset * t / END_S) for value in true_motion(t)] + [0.5, -0.25]
    sigmas = (0.6, 0.4, 0.3, 0.2, 0.2, 0.1, 0.05, 0.7, 0.7)
    covariance = [[s * s * (i == j) + 0.02 * (i + j == 1) for j in range(9)] for i, s in enumerate(sigmas)]
    image = MeasurementReport(
        source="front",
        t_ns=_ns(t) - 60_000_000,
        t_recv_ns=EPOCH + _ns(t),
        verdict=verdict,
        components=("azimuth", "elevation", "subtended"),
        nis=3.0 + 2.0 * math.sin(k) if t >= 2.0 else None,
        points=_points(t),
    )
    return Estimate(
        name=name,
        target=name,
        sequence=k,
        t_ns=_ns(t),
        state=state,
        valid=state.is_valid,
        cause=Cause.FUSED,
        reason="fused" if fused else "rejected",
        frame="n",
        components=relative_motion.COMPONENTS,
        units=relative_motion.UNITS,
        mean=tuple(mean) if t >= 2.0 else None,
        covariance=tuple(map(tuple, covariance)) if t >= 2.0 else None,
        age=0.06,
        reset_count=int(t >= GAP_S[1]),
        measurement=image,
    )


def own_state(k: int) -> Any:
    """Our own state after the k-th fifth of a second: not valid for a second, and two faults."""
    t = k / 5
    return nav_state(
        round(1000 * t),
        valid=t >= 1.0,
        state=_state(t),
        nis_ratio=None if t < 0.5 else 1.0 + 0.5 * math.cos(k),
        faults=tuple(fault for fault in FAULTS if fault.t_onset_ns <= _ns(t)),
    )


def outputs(end_s: float = END_S) -> Iterator[Output]:
    """All outputs in order: our own motion and the leader ten times a second, our own state five times."""
    for k in range(1, round(10 * end_s)):
        yield own_pose(k / 10)
        if k % 2 == 0:
            yield own_state(k // 2)
        yield leader(k)


def heard() -> Iterator[tuple[Message, float]]:
    """What the autopilot sends of the vehicle, with the boot time."""
    at = {"t_ns": 0, "t_recv_ns": 0, "system": 1}
    for k in range(400):
        t = k / 10
        yield Imu(**at, f_b=(0.1 * (-1) ** k, math.sin(0.02 * k), -9.8 - 0.3 * (k % 3)), omega_b=(0, 0, 0)), t
        yield Battery(**at, voltage_v=16.2 - 0.002 * k), t
        yield ActuatorOutputs(**at, port=k % 2, pwm_us=(1500, 1510 + k % 7, 1520, 0)), t
        accuracy = {"h_acc": None, "v_acc": None} if k < 30 else {"h_acc": 0.8, "v_acc": 1.2}
        place = {"lat_deg": 47.0 + 2e-6 * k, "lon_deg": 8.5 + 1e-6 * k, "alt_msl": 500.0}
        known = {"satellites": 5 + k // 50, "ground_speed": None, "course_rad": None}
        yield GpsFix(**at, **place, **accuracy, **known, fix_type=1 if k < 30 else 3), t
        if k % 100 == 0:
            armed, mode = k >= 100, 23 if k >= 200 else 5
            kind = {"vehicle_type": 2, "autopilot": 3, "status": 4}
            yield Heartbeat(**at, **kind, armed=armed, custom_mode=mode), t
    yield StatusText(**at, severity=4, text="Low\x1b[31m battery"), 33.0
    for k in range(8):
        yield ParamValue(**at, extended=False, name=f"P{k}", value=1e-9 * k, default=None), 33.5
    for name, value, default in (("MASK", 15012864.0, None), ("WPNAV", 1200.0, 1000.0), ("ANGLE", 0.1, 0.1)):
        yield ParamValue(**at, extended=False, name=name, value=value, default=default), 34.0
    yield ParamValue(**at, extended=False, name="MASK", value=3.0, default=None), 35.0


def health(config: Config) -> Health:
    """The health at the end: a slow stream, refusals before and during the flight, an error of ours."""
    found = Pipeline(config).health(EPOCH + _ns(END_S))
    changed: dict[str, Any] = {
        "autopilot": "ArduPilot 4.5, system 1",
        "clock_source": "timesync",
        "clock_offset_ns": EPOCH,
        "clock_rate": 1.0002,
        "round_trip": 0.0123,
        "streams": {
            "Attitude": StreamHealth(count=2000, rate=50.0, age=0.02),
            "LocalPosition": StreamHealth(count=400, rate=10.0, age=0.1),
        },
        "rejected": {"error in leader": 2, "of another system": 30},
        "verdicts": {"leader.fused": 340},
        "refusals": (
            Refusal(source="log", reason="no time", count=1, t_recv_ns=0),
            Refusal(source="camera front", reason="`t_ns` is missing", count=3, t_recv_ns=EPOCH + _ns(12.5)),
        ),
        "reasons": {"leader": "coasting for 1 s"},
    }
    return Health(**{name: getattr(found, name) for name in found.__struct_fields__} | changed)


def replay(
    _: object,
    config: Config,
    *,
    take: Callable[[Any], None],
    hear: Callable[[Message, float], None] | None = None,
    take_health: Callable[[Health], None] | None = None,
    **__: Any,
) -> ReplayResult:
    """What `onboard.analysis.flights.replay` makes of this flight, with an estimator named `paper` beside."""
    for k, output in enumerate(outputs()):
        take(output)
        if isinstance(output, Estimate) and output.name == "leader":
            take(leader(output.sequence, "paper", 0.3))
        if take_health is not None and k % 25 == 0:
            take_health(health(config))
    for message, t in heard() if hear is not None else ():
        hear(message, t)
    return ReplayResult([], health(config), 12345, 2, END_S, [], END_S, {})

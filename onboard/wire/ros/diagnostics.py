"""Health records -> ROS diagnostics: one status per program, estimator and sink."""

from collections.abc import Iterator
from typing import Final, NamedTuple

from onboard.messages import Health, Lifecycle, Severity
from onboard.units import S_PER_NS

OK, WARN, ERROR = 0, 1, 2  # diagnostic_msgs/DiagnosticStatus
OF_SEVERITY: Final = {Severity.ERROR: ERROR, Severity.WARNING: WARN, Severity.NOTICE: OK}
OF_STATE: Final = {Lifecycle.TRACKING: OK, Lifecycle.LOST: ERROR}  # any other: WARN


class Status(NamedTuple):
    """One line of diagnostics, and what it unfolds to."""

    level: int
    name: str
    message: str
    values: dict[str, str]


def statuses(health: Health) -> Iterator[Status]:
    """The statuses of the program, each estimator and target, our own faults, and each sink."""
    yield _program(health)
    for name, state in health.states.items():
        values = {
            key.removeprefix(f"{name}."): str(count)
            for key, count in health.verdicts.items()
            if key.startswith(f"{name}.")
        }
        reason = health.reasons.get(name, "")
        message = f"{state}: {reason}" if reason else str(state)
        yield Status(OF_STATE.get(state, WARN), f"onboard: {name}", message, values)
    if "own_state" in health.states:
        faults = {fault.name: f"{fault.magnitude:.2f} {fault.unit}" for fault in health.faults}
        yield Status(ERROR if faults else OK, "onboard: vehicle", ", ".join(faults) or "no fault", faults)
    for name, sink in health.sinks.items():
        counts = {"sent": str(sink.sent), "dropped": str(sink.dropped), "restarts": str(sink.restarts)}
        yield Status(ERROR if sink.error else OK, f"onboard: sink {name}", sink.error or "running", counts)


def _program(health: Health) -> Status:
    """The advice, and the rates."""
    levels = [OF_SEVERITY[advice.severity] for advice in health.advice]
    values = {f"{one.cause} {one.about}".strip(): f"{one.what}; {one.remedy}" for one in health.advice}
    values |= {f"{name}, Hz": f"{stream.rate:.1f}" for name, stream in health.streams.items()}
    values |= {f"camera {name}, Hz": f"{camera.rate:.1f}" for name, camera in health.cameras.items()}
    if health.clock_offset_ns is not None:
        values["clock offset, s"] = f"{health.clock_offset_ns * S_PER_NS:.6f}"
    message = health.advice[0].what if health.advice else "nothing is wrong"
    return Status(max(levels, default=OK), "onboard", message, values)

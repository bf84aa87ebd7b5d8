"""One filter over a batch of flights of the quadrotor: its estimates and their consistency."""

from typing import Any, Final, Literal, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters import cubature_smooth, methods
from onboard.filters.belief import FilterError, Rows
from onboard.filters.gating import normalised_squared
from onboard.models import quadrotor
from onboard.models.quadrotor import RATES, VELOCITY
from studies.csvsf_quadrotor import reference_flight
from studies.csvsf_quadrotor.cases import FAULT_TIME_S, NOMINAL, Case, Sensor, Variant, matrices, one
from studies.csvsf_quadrotor.reference_flight import DT

CONSISTENCY_PERIOD_STEPS: Final = 10
FAULT_STEP: Final = round(FAULT_TIME_S / DT)
# what a smooth filter keeps of each sensor
MEMORY: Final = ("residual", "updates_outside", "switching", "slow_switching")


class Method(NamedTuple):
    """A filter of `onboard.filters`.

    `widened`: its process noise Q of velocity and rates over the truth's. `inputs`, which drive its model: the
    commands; thrust by the accelerometer, u = -m f_z; or all of the specific force.
    """

    name: str
    label: str
    filter: str
    widened: float = 1.0
    inputs: Literal["commands", "thrust", "force"] = "commands"
    fading: float = cubature_smooth.FADING_FRACTION  # settings of the adaptive form
    patience: int = cubature_smooth.MIN_EXCEEDANCE_STEPS


CKF: Final = Method("ckf", "CKF", "cubature")
WIDE: Final = Method("ckf-wide", "CKF, vel and rate Q x 300", "cubature", widened=300.0)
UKF: Final = Method("ukf", "UKF", "unscented")
EKF: Final = Method("ekf", "EKF", "extended")
AUGMENTED: Final = Method("ukf-augmented", "UKF, augmented by the noise", "augmented")
SVSF: Final = Method("svsf", "SVSF, zero layer", "svsf-zero-layer")
LAYER: Final = Method("svsf-layer", "SVSF, layer 5 sigma", "svsf")
PRINTED: Final = Method("csvsf-printed", "CSVSF as printed", "csvsf-printed")
RECURSIVE: Final = Method("csvsf", "CSVSF recursive", "csvsf")
ROBUST: Final = Method("csvsf-robust", "CSVSF robust (3 samples)", "csvsf-robust")
ADAPTIVE: Final = Method("csvsf-adaptive", "CSVSF adaptive", "csvsf-adaptive")
METHODS: Final = (CKF, WIDE, UKF, EKF, AUGMENTED, SVSF, LAYER, PRINTED, RECURSIVE, ROBUST, ADAPTIVE)

MAIN: Final = ("none", "weak", "motor", "outliers")  # the reference's columns
OTHERS: Final = tuple(m for m in METHODS if m not in (UKF, EKF, AUGMENTED, LAYER))

THRUST: Final = tuple(
    m._replace(name=f"{m.name}-thrust", label=f"{m.label}, thrust measured", inputs="thrust")
    for m in (CKF, ADAPTIVE)
)
FORCE: Final = tuple(
    m._replace(name=f"{m.name}-force", label=f"{m.label}, specific force measured", inputs="force")
    for m in (CKF, ADAPTIVE)
)
HIDDEN_METHODS: Final = (CKF, WIDE, SVSF, RECURSIVE, ROBUST, ADAPTIVE, *FORCE)
MULTIRATE_METHODS: Final = (CKF, RECURSIVE, ADAPTIVE, *THRUST, *FORCE)
EVERY: Final = {m.name: m for m in (*METHODS, *THRUST, *FORCE)}


def methods_on(variant: Variant) -> tuple[Method, ...]:
    """The methods that are flown on a variant."""
    if variant.multirate:
        return MULTIRATE_METHODS
    if len(variant.sensors[0].states) < quadrotor.STATE_SIZE:
        return HIDDEN_METHODS
    return METHODS if variant.name in MAIN else OTHERS


class Track(NamedTuple):
    """The estimates of one filter over B flights, and their consistency from 10 s on."""

    mean: Array  # (N, B, 12), NaN after a failure
    nees: Array  # (B,), the mean from 10 s on
    nis: Array  # (B,), of the first sensor, likewise
    switching: Array  # (N, B, m), of that sensor; zero for other filters
    # The filter's state and its memory of each sensor at 10 s, where the late variants continue.
    halfway: tuple[Any, dict[Sensor, Any]] | None = None


def track(case: Case, variant: Variant, method: Method, since: Track | None = None) -> Track:
    """Run `method` over all flights of a case; if the batch fails numerically, over each by itself.

    `since` is the track of the same flights without error: a late variant continues from its tenth second.
    """
    B = case.start.shape[0]
    found = _track(case, variant, method, since)
    if B == 1 or np.isfinite(found.mean).all():
        return found
    alone = [_track(one(case, b), variant, method, None) for b in range(B)]
    joined: dict[str, Any] = {
        name: np.concatenate([getattr(t, name) for t in alone], axis=axis)
        for name, axis in (("mean", 1), ("nees", 0), ("nis", 0), ("switching", 1))
    }
    return Track(**joined)


def _track(case: Case, variant: Variant, method: Method, since: Track | None) -> Track:
    """Run `track` until the batch fails."""
    steps, B = case.inputs.shape[:2]
    flown, Q = methods()[method.filter], _process_noise(method.widened)
    state = flown.start(case.start, np.tile(4.0 * case.R, (B, 1, 1)))
    first, begin = variant.sensors[0], 0
    mean = np.full((steps, B, quadrotor.STATE_SIZE), np.nan)
    switching = np.zeros((steps, B, len(first.states)))
    nees, nis = [], []
    memory: dict[Sensor, Any] = {}
    halfway = None
    if since is not None and since.halfway is not None:
        begin = FAULT_STEP
        mean[:begin], switching[:begin] = since.mean[:begin], since.switching[:begin]
        state, memory = since.halfway[0], dict(since.halfway[1])
    try:
        for k in range(begin, steps):
            if k == FAULT_STEP:
                halfway = state, dict(memory)
            state = flown.predict(state, _process(case, k, method), Q)
            for sensor in variant.sensors:
                if (k + 1) % sensor.every:
                    continue
                update = _update(flown, method, _recall(state, memory.get(sensor), variant), case, k, sensor)
                state = update.belief
                if hasattr(state, "residual"):
                    memory[sensor] = state
                if sensor is first and k * DT >= FAULT_TIME_S:
                    nis.append(update.nis)
            belief = flown.belief(state)
            mean[k] = belief.mean
            if first in memory and memory[first].switching.shape[-1]:
                switching[k] = memory[first].switching
            if k * DT >= FAULT_TIME_S and k % CONSISTENCY_PERIOD_STEPS == 0:
                nees.append(normalised_squared(belief.mean - case.states[k + 1], belief.covariance))
    except FilterError:  # numerical: the rest of `mean` stays NaN
        pass
    return Track(mean, _mean(nees, B), _mean(nis, B), switching, halfway)


def _process(case: Case, k: int, method: Method) -> Rows:
    """Return the model of step `k` with the nominal parameters and the inputs that drive the filter."""
    inputs, force = case.inputs[k], case.force[k]
    if method.inputs != "commands":
        inputs = np.concatenate([-NOMINAL.mass * force[:, 2:], inputs[:, 1:]], axis=1)

    def process(rows: Array) -> Array:
        after = quadrotor.process(rows, inputs, DT, NOMINAL)
        if method.inputs == "force":
            lateral = np.repeat(force[:, :2], len(rows) // len(force), axis=0)
            after[:, list(VELOCITY)] += DT * np.einsum("kij,kj->ki", matrices(rows)[:, :, :2], lateral)
        return after

    return process


def _update(flown: Any, method: Method, state: Any, case: Case, k: int, sensor: Sensor) -> Any:
    measured = list(sensor.states)
    R, y = case.R[measured][:, measured], case.measurements[k][:, measured]

    def measure(rows: Array) -> Array:
        return rows[:, measured]

    if method.filter == ADAPTIVE.filter:
        settings: Any = {"fading": method.fading, "patience": method.patience}
        return cubature_smooth.update_adaptive(state, y, measure, R, **settings)
    return flown.update(state, y, measure, R, ())


def _recall(state: Any, last: Any, variant: Variant) -> Any:
    """Return the state with the memory of this sensor, as each sensor has its own residuals."""
    if len(variant.sensors) == 1 or not hasattr(state, "residual"):
        return state
    if last is None:
        return state._replace(**{name: getattr(state, name)[..., :0] for name in MEMORY})
    return state._replace(**{name: getattr(last, name) for name in MEMORY})


def _process_noise(widened: float) -> Array:
    Q = reference_flight.process_noise()
    which = [*VELOCITY, *RATES]
    Q[which, which] *= widened
    return Q


def _mean(figures: list[Any], count: int) -> Array:
    return np.mean(figures, axis=0) if figures else np.full(count, np.nan)

"""Sequences of images of all kinds through the leader's estimators: right, wrong and impossible ones, doubled, out
of order, late, early and missing, of one target and of several, with own motion as bad.

    nice python -m tests.fuzz --sequences 1000000 --seed 7       # most of an hour on one core
    python -m tests.fuzz --seed 7 --only 123456                  # one of them again

Each sequence is drawn from its own number, by which a failing one can be repeated.
"""

import argparse
import math
import sys
from collections import Counter
from functools import lru_cache
from typing import ClassVar, Final, NamedTuple

import numpy as np
from msgspec.structs import replace
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from onboard.arrays import Array
from onboard.estimators import EstimatorProtocol
from onboard.estimators.leader import estimator as leader
from onboard.estimators.leader.config import Config
from onboard.estimators.oh_johnson import estimator as oh_johnson
from onboard.geometry.camera import make_camera
from onboard.messages import Cause, Estimate, Exposure, Lifecycle, Message, Reason, TargetPoints
from onboard.ownship import Ownship
from tests.support.streams import EPOCH, MS, Flight, S, make_config

EXTREMES: Final = (0.0, 1e-300, 1e-9, 0.3, 0.57, 1.0, 99.0, 1e6, 1e300, -1e300, math.nan, math.inf, -math.inf)
STEPS_MS: Final = (0, 1, 20, 33, 33, 33, 40, 100, 500, 3000, 12000)  # from one image to the next
LATE_MS: Final = (0, 0, 0, 0, 20, 60, 150, 300, 2000, -10, -30, -5000)  # an image after its time
TARGETS: Final = ("leader", "leader", "leader", "target/1", "")
CAMERA: Final = make_camera(f_px=554.256, width_px=640, height_px=480)


class PromptConfig(Config, frozen=True, kw_only=True):
    """A leader that starts with its first image, so that short sequences have tracks."""

    initialise_images: ClassVar[int] = 1


CONFIGS: Final = {
    "plain": Config(),
    "fixed-wing": PromptConfig(leader_class="fixed_wing", center_on_wing=True),
    "delay": PromptConfig(delay_sigma_s=0.1),
    "exact attitude": PromptConfig(own_tilt_sigma_deg=0.0, own_yaw_sigma_deg=0.0),
    "middle": PromptConfig(center_on_wing=True),
    "delay, size unknown": PromptConfig(delay_sigma_s=0.3, size_prior_sigma_m=2.0),
}
PAPER: Final = "oh_johnson"  # the paper's filter, an estimator of its own, with its defaults
NAMES: Final = (*CONFIGS, PAPER)


class UnsoundError(AssertionError):
    """An estimate that must not go out."""


class Drawn(NamedTuple):
    """A sequence: the name of its settings, its flight, the share of wrong images, the share of own motion that is
    wrong, missing or doubled, and the number of images."""

    name: str
    flight: Flight
    wrong: float
    lost: float
    images: int


def run(seed: int, number: int, name: str | None = None, longest: int = 8) -> Counter[str]:
    """Run one sequence, with the settings of that name or of any. Counts of its images' verdicts and of states.

    Raises UnsoundError, and whatever the estimator raises, which it must not.
    """
    rng = np.random.default_rng([seed, number])
    drawn = _draw(rng, name, longest)
    one, ownship = estimator(drawn.name), Ownship(max_extrapolation=0.1)
    count: Counter[str] = Counter()
    _fly(drawn.flight, 5 * S - 60 * MS, ownship, None)
    for arrived_ns, message in _in_order_of_arrival(rng, drawn):
        if rng.random() >= drawn.lost:
            _fly(drawn.flight, arrived_ns, ownship, (rng, drawn.lost))
            check(one.tick(ownship), count)
        if message is None:
            one.reset(Reason(Cause.REBOOTED, "the autopilot has rebooted"))
            ownship = Ownship(max_extrapolation=0.1)
            continue
        estimates = one.observe(Exposure.of(message), ownship)
        check(estimates, count)
        count.update(str(e.measurement.verdict) for e in estimates if e.measurement is not None)
    return count


def estimator(name: str) -> EstimatorProtocol:
    """The estimator that is flown with the settings of a name."""
    if name == PAPER:
        return oh_johnson.Estimator(make_config("estimator.oh_johnson={}").estimator[PAPER], CAMERA)
    return leader.Estimator(CONFIGS[name], CAMERA)


def _fly(flight: Flight, t_ns: int, ownship: Ownship, spoil: tuple[np.random.Generator, float] | None) -> None:
    for message in _own(flight, t_ns):
        ownship.receive(message if spoil is None else _spoilt(spoil[0], message, spoil[1]), t_ns)


@lru_cache(maxsize=20_000)  # sequences share times and flights, and the time should go to the filter
def _own(flight: Flight, t_ns: int) -> tuple[Message, ...]:
    return flight.attitude(t_ns), flight.position(t_ns)


@lru_cache(maxsize=20_000)
def _points(flight: Flight, t_ns: int) -> Array:
    points = flight.points(t_ns / S)
    points.flags.writeable = False
    return points


def _draw(rng: np.random.Generator, name: str | None, longest: int) -> Drawn:
    u = rng.random(6)
    flight = Flight(
        radius=(40.0, 200.0, None)[int(3 * u[0])],  # the last: straight
        speed=(0.1, 3.0, 12.0, 30.0)[int(4 * u[1])],
        gap=(3.0, 10.0, 28.0, 60.0)[int(4 * u[2])],
    )
    tame = u[3] < 0.5
    wrong, lost = (0.2, 0.02) if tame else (0.7, 0.3)
    return Drawn(
        name or NAMES[int(len(NAMES) * u[4])],
        flight,
        wrong,
        lost,
        4 + int((longest - 3) * u[5] * u[5]),
    )


def _in_order_of_arrival(rng: np.random.Generator, drawn: Drawn) -> list[tuple[int, TargetPoints | None]]:
    """(when it arrives, image), None for a reboot. Times and delays are of all sizes, or of a camera's."""
    steady = drawn.lost < 0.1
    out: list[tuple[int, TargetPoints | None]] = []
    t_ns, before = 5 * S, None
    for u in rng.random((drawn.images, 6)):
        t_ns += (33 if steady and u[0] < 0.9 else STEPS_MS[int(len(STEPS_MS) * u[1])]) * MS
        late_ns = (40 if steady and u[2] < 0.7 else LATE_MS[int(len(LATE_MS) * u[3])]) * MS
        image = before if before is not None and u[4] < 0.05 else _image(rng, t_ns, drawn)
        before = image
        out.append((t_ns + late_ns, image if u[5] > 0.01 else None))
    if not steady and rng.random() < 0.3:  # arrivals shuffled altogether
        arrivals = sorted(arrival for arrival, _ in out)
        out = [(arrivals[i], out[j][1]) for i, j in enumerate(rng.permutation(len(out)))]
    return sorted(out, key=lambda pair: pair[0])


def _image(rng: np.random.Generator, t_ns: int, drawn: Drawn) -> TargetPoints:
    """A right image, a wrong one, or an impossible one."""
    points = _points(drawn.flight, t_ns) + rng.normal(size=(3, 2)) / 554.0
    u = rng.random(4)
    if u[0] < drawn.wrong:
        kind = int(5 * u[1])
        if kind == 0:
            points = rng.uniform(-0.6, 0.6, (3, 2))
        elif kind == 1:  # any number in any place
            where = rng.random((3, 2)) < 0.4
            points[where] = np.array(EXTREMES)[rng.integers(0, len(EXTREMES), int(where.sum()))]
        elif kind == 2:
            points = points[[0, 2, 1]]  # the wingtips the wrong way round
        elif kind == 3:
            points[1:] = points[0]  # no span at all
        else:
            points = points + rng.uniform(-0.2, 0.2, 2)  # another aircraft
    sigma = None
    if u[2] < 0.3 * drawn.wrong:
        a, b = (EXTREMES[i] for i in rng.integers(0, len(EXTREMES), 2))
        sigma = (a, b, abs(float(rng.normal(0, 1e-3))))
    center, left, right = (tuple(p) for p in points.tolist())
    target = TARGETS[int(len(TARGETS) * u[3])] if drawn.wrong > 0.5 else "leader"
    return TargetPoints(
        t_ns=t_ns,
        t_recv_ns=EPOCH + t_ns,
        camera="fuzz",
        target=target,
        center=center,
        left=left,
        right=right,
        sigma=sigma,
    )


def _spoilt(rng: np.random.Generator, message, share: float):  # type: ignore[no-untyped-def]
    """A message of our own motion: unchanged, with an old stamp, or with an impossible number."""
    u = rng.random(3)
    if u[0] >= share:
        return message
    if u[1] < 0.3:
        return replace(message, t_ns=message.t_ns - 20 * MS)
    field = "v_F_n" if hasattr(message, "v_F_n") else ("omega_b" if u[1] < 0.6 else "q_nb")
    values = list(getattr(message, field))
    values[int(len(values) * u[2])] = EXTREMES[int(rng.integers(0, len(EXTREMES)))]
    return replace(message, **{field: tuple(values)})


def check(estimates: list[Estimate], count: Counter[str]) -> None:
    """Count the states of estimates. Raises UnsoundError."""
    for e in estimates:
        count[str(e.state)] += 1
        if e.mean is None or e.covariance is None:
            if e.valid or e.mean is not None or e.covariance is not None:
                raise UnsoundError(f"half an estimate: {e}")
            continue
        P = np.array(e.covariance)
        if not (all(map(math.isfinite, e.mean)) and np.isfinite(P).all()):
            raise UnsoundError(f"not finite: {e}")
        if not (P == P.T).all():
            raise UnsoundError(f"not symmetric: {e}")
        try:
            np.linalg.cholesky(P)
        except np.linalg.LinAlgError as error:
            raise UnsoundError(f"not positive definite: {e}") from error
        if e.valid != (e.state in (Lifecycle.TRACKING, Lifecycle.COASTING)) or (
            e.valid and (e.age is None or e.age > 2.0)
        ):
            raise UnsoundError(f"valid, or not, without reason: {e}")
        m = e.measurement
        if m is not None and m.nis is not None and not (m.nis >= 0 and math.isfinite(m.nis)):
            raise UnsoundError(f"NIS: {m}")


def main() -> int:
    """Run, with progress; the first that fails ends it, with its number."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description="Sequences through the estimator.")
    parser.add_argument("--sequences", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--first", type=int, default=0, help="number of the first sequence")
    parser.add_argument("--only", type=int, help="one sequence, by its number")
    options = parser.parse_args()
    numbers = range(options.first, options.first + options.sequences)
    if options.only is not None:
        numbers = range(options.only, options.only + 1)
    count: Counter[str] = Counter()
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns) as progress:
        task = progress.add_task("sequences", total=len(numbers))
        for number in numbers:
            try:
                count.update(run(options.seed, number))
            except Exception:
                progress.console.print(f"seed {options.seed}, sequence {number} fails:")
                progress.console.print_exception()
                return 1
            progress.advance(task)
            done = number - numbers[0] + 1
            if not progress.console.is_terminal and done % 10_000 == 0:
                print(f"{done} of {len(numbers)} sequences", flush=True)
    print(f"{len(numbers)} sequences, seed {options.seed}: no exception, nothing unsound")
    print("  ".join(f"{name} {number}" for name, number in sorted(count.items())))
    return 0


if __name__ == "__main__":
    sys.exit(main())

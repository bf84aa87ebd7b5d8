"""All figures, under the keys of bench.json.

Every ratio is peer / ours, or as its key says; both are measured in this run.
"""

import platform
from collections.abc import Callable
from importlib.metadata import version
from typing import Any

from benchmarks import radar, square_root, start_up, targets, traffic, vision
from benchmarks.timing import Side, compare

BATCH_SIZE = 500
Figures = dict[str, dict[str, Any]]
Times = Callable[[Side, Side], tuple[float, float]]


class DisagreementError(Exception):
    """The peers' results differ from ours, so that no ratio is meaningful."""


def figures(pairs: int = 21, scale: float = 1.0, starts: int = 5) -> Figures:
    """Measure everything with `pairs` pairs for each ratio, of `scale` times the usual steps.

    Raises DisagreementError.
    """
    if not (radar.agree() and vision.agree()):
        raise DisagreementError("ours and the peers' results differ: no ratio would mean anything")

    def times(ours: Side, peer: Side) -> tuple[float, float]:
        """Return our microseconds, and the ratio of the peer's time to ours."""
        made = compare(_scaled(ours, scale), _scaled(peer, scale), pairs)
        return made.ours_us, made.times

    return {
        **_radar(times),
        "vision_ukf": _vision(times),
        "batch_ukf": _batch(times, Side(vision.batch(BATCH_SIZE), 10, BATCH_SIZE), Side(vision.filterpy, 20)),
        "batch_radar": _batch(times, Side(radar.batch(BATCH_SIZE), 10, BATCH_SIZE), Side(radar.filterpy, 60)),
        "square_root": _square_root(times),
        "leader_targets": targets.measure(scale),
        "traffic_tracks": traffic.measure(scale),
        "startup": start_up.measure(starts)._asdict(),
        "versions": {name: version(name) for name in ("filterpy", "stonesoup", "numpy")}
        | {"python": platform.python_version()},
        "settings": {"pairs": pairs, "batch": BATCH_SIZE, "threads": 1},
    }


def _scaled(side: Side, scale: float) -> Side:
    return side._replace(steps=max(1, round(side.steps * scale)))


def _radar(times: Times) -> Figures:
    ours, filterpy = Side(radar.ours, 2000), Side(radar.filterpy, 60)
    us, to_filterpy = times(ours, filterpy)
    own_us, own_to_filterpy = times(Side(radar.ours_own_model, 2000), filterpy)
    numpy_us, numpy_to_filterpy = times(Side(radar.ours_numpy, 1000), filterpy)
    return {
        "radar_ukf": {
            "us": us,
            "us_in_two_calls": times(Side(radar.ours_in_two_calls, 2000), ours)[0],
            "times_faster_than_filterpy": to_filterpy,
            "times_faster_than_filterpy_our_model": times(ours, Side(radar.filterpy_compiled, 60))[1],
            "times_faster_than_stonesoup": times(ours, Side(radar.stonesoup, 20))[1],
        },
        "radar_ukf_own_model": {"us": own_us, "times_faster_than_filterpy": own_to_filterpy},
        "radar_ukf_numpy_model": {"us": numpy_us, "times_faster_than_filterpy": numpy_to_filterpy},
    }


def _vision(times: Times) -> dict[str, Any]:
    ours = Side(vision.ours, 2000)
    us, to_filterpy = times(ours, Side(vision.filterpy, 20))
    return {
        "us": us,
        "us_in_two_calls": times(Side(vision.ours_in_two_calls, 2000), ours)[0],
        "times_faster_than_filterpy": to_filterpy,
        "times_faster_than_filterpy_our_model": times(ours, Side(vision.filterpy_compiled, 60))[1],
    }


def _square_root(times: Times) -> dict[str, Any]:
    """Measure the square-root filter, in microseconds and relative to the unscented filter."""
    us, ratio = times(Side(square_root.ours, 1000), Side(square_root.unscented_ours, 1000))
    two_us, two_ratio = times(Side(square_root.run(), 1000), Side(square_root.unscented_run(), 1000))
    many = square_root.run(BATCH_SIZE), square_root.unscented_run(BATCH_SIZE)
    many_us, many_ratio = times(Side(many[0], 4, BATCH_SIZE), Side(many[1], 4, BATCH_SIZE))
    return {
        "us": us,
        "times_ukf": 1 / ratio,
        "us_in_two_calls": two_us,
        "times_ukf_in_two_calls": 1 / two_ratio,
        "batch_us": many_us,
        "batch_times_ukf": 1 / many_ratio,
    }


def _batch(times: Times, ours: Side, peer: Side) -> dict[str, float]:
    """Measure a batch, per filter and step, on one core."""
    us, ratio = times(ours, peer)
    return {"us_per_step": us, "steps_per_s": 1e6 / us, "times_faster_than_filterpy": ratio}

"""All figures, under the keys of bench.json. Every ratio is peer / ours, or as its key says; both in this run."""

import platform
from importlib.metadata import version
from typing import Any

from benchmarks import radar, square_root, start_up, targets, traffic, vision
from benchmarks.timing import Side, compare

BATCH = 500
Figures = dict[str, dict[str, Any]]


class DisagreementError(Exception):
    """The peers' results differ from ours, so no ratio would mean anything."""


def figures(pairs: int = 21, scale: float = 1.0, starts: int = 5) -> Figures:
    """Measure everything: `pairs` pairs for each ratio, of `scale` times the usual number of steps.

    Raises DisagreementError.
    """
    if not (radar.agree() and vision.agree()):
        raise DisagreementError("ours and the peers' results differ: no ratio would mean anything")

    def side(run: Any, steps: int, filters: int = 1) -> Side:
        return Side(run, max(1, round(steps * scale)), filters)

    def times(ours: Side, peer: Side) -> tuple[float, float]:
        made = compare(ours, peer, pairs)
        return made.ours_us, made.times

    us, filterpy = times(side(radar.ours, 2000), side(radar.filterpy, 60))
    two_calls, _ = times(side(radar.ours_in_two_calls, 2000), side(radar.ours, 2000))
    _, our_model = times(side(radar.ours, 2000), side(radar.filterpy_compiled, 60))
    _, stonesoup = times(side(radar.ours, 2000), side(radar.stonesoup, 20))
    radar_ukf = {
        "us": us,
        "us_in_two_calls": two_calls,
        "times_faster_than_filterpy": filterpy,
        "times_faster_than_filterpy_our_model": our_model,
        "times_faster_than_stonesoup": stonesoup,
    }
    us, filterpy = times(side(radar.ours_own_model, 2000), side(radar.filterpy, 60))
    radar_own = {"us": us, "times_faster_than_filterpy": filterpy}
    us, filterpy = times(side(radar.ours_numpy, 1000), side(radar.filterpy, 60))
    radar_numpy = {"us": us, "times_faster_than_filterpy": filterpy}
    us, filterpy = times(side(vision.ours, 2000), side(vision.filterpy, 20))
    two_calls, _ = times(side(vision.ours_in_two_calls, 2000), side(vision.ours, 2000))
    _, our_model = times(side(vision.ours, 2000), side(vision.filterpy_compiled, 60))
    vision_ukf = {
        "us": us,
        "us_in_two_calls": two_calls,
        "times_faster_than_filterpy": filterpy,
        "times_faster_than_filterpy_our_model": our_model,
    }
    root = times(side(square_root.ours, 1000), side(square_root.unscented_ours, 1000))
    root_two_calls = times(side(square_root.run(), 1000), side(square_root.unscented_run(), 1000))
    many = times(side(square_root.run(BATCH), 4, BATCH), side(square_root.unscented_run(BATCH), 4, BATCH))
    return {
        "radar_ukf": radar_ukf,
        "radar_ukf_own_model": radar_own,
        "radar_ukf_numpy_model": radar_numpy,
        "vision_ukf": vision_ukf,
        "batch_ukf": _batch(side(vision.batch(BATCH), 10, BATCH), side(vision.filterpy, 20), pairs),
        "batch_radar": _batch(side(radar.batch(BATCH), 10, BATCH), side(radar.filterpy, 60), pairs),
        "square_root": {
            "us": root[0],
            "times_ukf": 1 / root[1],
            "us_in_two_calls": root_two_calls[0],
            "times_ukf_in_two_calls": 1 / root_two_calls[1],
            "batch_us": many[0],
            "batch_times_ukf": 1 / many[1],
        },
        "leader_targets": targets.measure(scale),
        "traffic_tracks": traffic.measure(scale),
        "startup": start_up.measure(starts)._asdict(),
        "versions": {name: version(name) for name in ("filterpy", "stonesoup", "numpy", "numba")}
        | {"python": platform.python_version()},
        "settings": {"pairs": pairs, "batch": BATCH, "threads": 1},
    }


def _batch(ours: Side, peer: Side, pairs: int) -> dict[str, float]:
    """Per filter and step, on one core."""
    made = compare(ours, peer, pairs)
    return {
        "us_per_step": made.ours_us,
        "steps_per_s": 1e6 / made.ours_us,
        "times_faster_than_filterpy": made.times,
    }

"""The benchmarks run and tell what they promise; how fast anything is, no test says."""

import io
import json

import pytest
from rich.console import Console

from benchmarks import radar, vision
from benchmarks.__main__ import table
from benchmarks.measuring import figures
from benchmarks.traffic import COUNTS

KEYS = {
    "radar_ukf": {
        "us",
        "us_in_two_calls",
        "times_faster_than_filterpy",
        "times_faster_than_filterpy_our_model",
        "times_faster_than_stonesoup",
    },
    "radar_ukf_own_model": {"us", "times_faster_than_filterpy"},
    "radar_ukf_numpy_model": {"us", "times_faster_than_filterpy"},
    "vision_ukf": {
        "us",
        "us_in_two_calls",
        "times_faster_than_filterpy",
        "times_faster_than_filterpy_our_model",
    },
    "batch_ukf": {"us_per_step", "steps_per_s", "times_faster_than_filterpy"},
    "batch_radar": {"us_per_step", "steps_per_s", "times_faster_than_filterpy"},
    "square_root": {
        "us",
        "times_ukf",
        "us_in_two_calls",
        "times_ukf_in_two_calls",
        "batch_us",
        "batch_times_ukf",
    },
    "leader_targets": {"targets", "one_core", "us_per_image", "fused", "without_id"},
    "traffic_tracks": {f"imm_{count}{what}" for count in COUNTS for what in ("", "_tracked")}
    | {"kf_500", "ekf_500", "ukf_500", "srukf_500", "per_track_ratio"},
    "startup": {"warm_s", "import_pipeline_s"},
    "versions": {"filterpy", "stonesoup", "numpy", "python"},
    "settings": {"pairs", "batch", "threads"},
}


@pytest.mark.slow
def test_every_figure_has_its_key_and_its_row() -> None:
    measured = figures(pairs=1, scale=1e-9, starts=1)
    assert {name: set(row) for name, row in measured.items()} == KEYS
    numbers = [value for row in measured.values() for value in row.values() if not isinstance(value, str)]
    assert all(number > 0 for number in numbers)
    assert json.loads(json.dumps(measured)) == measured
    console = Console(width=120, record=True, file=io.StringIO())
    console.print(table(measured))
    text = console.export_text()
    assert all(
        name in text
        for name in ("radar", "vision", "square root", "of a batch", "Stone Soup", "start", "leaders", "aircraft")
    )


def test_the_benchmarks_agree_with_their_peers_before_anything_is_timed() -> None:
    assert radar.agree()
    assert vision.agree()

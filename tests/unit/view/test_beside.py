"""Other estimators of the leader in the view: curves and an outline of each, beside the one that it is about."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.geometry.camera import Camera
from onboard.messages import Estimate
from tests.support.view_flight import flight, record_flight, rows_of

pytest.importorskip("rerun")

from onboard.view import layout

NAME = "oh_johnson"
FARTHER = 2.0  # m: by how much it is wrong


def farther(estimate: Estimate) -> Estimate:
    """Another estimator's estimate of the same time: the leader 2 m farther away."""
    assert estimate.mean is not None
    r = np.array(estimate.mean[:3])
    moved = r * (1 + FARTHER / np.linalg.norm(r))
    return replace(estimate, name=NAME, target=NAME, mean=(*moved.tolist(), *estimate.mean[3:]))


def pairs(seconds: float) -> list[Any]:
    """A flight with each estimate doubled."""
    records: list[Any] = []
    for record in flight(seconds):
        records.append(record)
        if isinstance(record, Estimate) and record.mean is not None:
            records.append(farther(record))
    return records


def test_the_window_names_it_with_its_colour_once_it_comes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[Any] = []

    def kept(camera: Camera, *shown: Any, **arranged: Any) -> Any:
        made.append(arranged)
        return layout.blueprint(camera, *shown, **arranged)

    monkeypatch.setattr("onboard.view.view.blueprint", kept)
    record_flight(tmp_path / "both.rrd", pairs(4.0))
    assert made[0] == {}
    assert made[-1]["beside"] == ((NAME, "lime"),)
    rows = rows_of(tmp_path / "both.rrd")
    ours = rows["/plots/range/estimate"]
    assert 0.4 * ours < rows[f"/plots/range/{NAME}"] <= ours
    assert rows[f"/plots/range_error/{NAME}"] > 0.8 * rows[f"/plots/range/{NAME}"]
    assert rows[f"/scene/beside/{NAME}"] > 30

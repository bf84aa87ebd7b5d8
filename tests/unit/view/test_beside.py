"""Other estimators of the leader in the view: curves and an outline of each, beside the one that it is about."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.testing import assert_allclose

from onboard.geometry.camera import Camera
from onboard.messages import Estimate, Truth
from tests.support.view_flight import Drawn, flight, record_flight, rows_of

pytest.importorskip("rerun")

from onboard.view import beside, layout, palette, plots
from onboard.view.columns import HIDDEN
from onboard.view.memory import Memory
from onboard.view.motion import leader_state

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


def test_its_range_error_and_outline_are_its_own() -> None:
    drawn, memory = Drawn(), Memory()
    records = [r for r in flight(4.0) if isinstance(r, Estimate | Truth)]
    truth, estimate = records[-2:]
    assert isinstance(truth, Truth)
    assert isinstance(estimate, Estimate)
    other = farther(estimate)
    for one, name in ((estimate, plots.OUR_ESTIMATOR), (other, NAME)):
        state = leader_state(one)
        assert state is not None
        if name == NAME:
            beside.draw(drawn, memory, one, state, palette.BESIDE_COLOURS["lime"])
        else:
            plots.plot_leader(drawn, memory, one.t_ns, state)
    memory.truths.extend([replace(truth, t_ns=truth.t_ns - 40_000_000), truth])
    plots.plot_errors(drawn, memory)
    values = drawn.values
    assert_allclose(values[f"plots/range/{NAME}"], values["plots/range/estimate"][0] + FARTHER)
    assert_allclose(values[f"plots/range_error/{NAME}"], values["plots/range_error"][0] + FARTHER)
    assert_allclose(values[f"scene/beside/{NAME}"].translation, other.mean[:3] if other.mean else ())
    assert values[f"scene/beside_tag/{NAME}"][2] == NAME
    assert memory.error == pytest.approx(np.linalg.norm(np.subtract(estimate.mean[:3], truth.r_FL_n)))
    beside.draw(drawn, memory, other, None, palette.BESIDE_COLOURS["lime"])
    assert np.isnan(values[f"plots/range/{NAME}"])
    assert values[f"scene/beside/{NAME}"] is HIDDEN


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

"""The example of a detector that learns: derivatives, what it learns in seconds, what it reads and writes."""

import sys
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from tests.unit.simlink.test_pictures import example

learned_train = example("learned_train")
learned: ModuleType = sys.modules["learned"]
NOTHING = np.zeros((480, 640), dtype=np.uint8)


def some(seed: int, count: int) -> list[Any]:
    return list(learned_train.draw_pictures(seed, count, learned_train.Scene(distances=(15.0, 30.0), empty=0.1)))


def off(network: Any, data: Any) -> float:
    """How far the likeliest places of points are off, px of a crop: the median over those that are in it."""
    share = learned.shares(learned.run(network, learned.levels(data.pictures)))
    found = [[learned.place(one[..., k])[:2] for k in range(3)] for one in share]
    errors = np.linalg.norm(learned.CELL["points"] * np.array(found) - data.places, axis=2)
    return float(np.nanmedian(errors))


@pytest.mark.parametrize(("name", "shape"), [("where", (24, 32)), ("points", (16, 16))])
def test_derivatives_are_those_of_the_loss_seed_1(name: str, shape: tuple[int, int]) -> None:
    random = np.random.default_rng(1)
    network = [
        learned.Layer(layer.weights.astype(float), random.normal(0.0, 0.1, layer.biases.shape), layer.stride)
        for layer in learned_train.make_network(name, random)
    ]
    x = 0.3 * random.normal(size=(3, *shape, 1))
    places = random.uniform(2.0, 14.0, (3, learned.CHANNELS[name][-1], 2))
    places[0] = np.nan
    wrong = partial(learned_train.loss_and_gradient, places=places, cell=learned.CELL[name])
    _, found = learned_train.gradients(network, x, wrong)
    for array, by_array in zip(learned_train.parameters(network), found, strict=True):
        at = tuple(random.integers(n) for n in array.shape)
        losses = []
        for step in (1e-7, -2e-7):  # a longer one passes a bend of the rectifier
            array[at] += step
            losses.append(wrong(learned.run(network, x))[0])
        array[at] += 1e-7
        assert by_array[at] == pytest.approx((losses[0] - losses[1]) / 2e-7, rel=1e-3, abs=1e-6)


@pytest.mark.parametrize(
    ("pictures", "steps", "share"), [(30, 30, 0.8), pytest.param(60, 60, 0.5, marks=pytest.mark.slow)]
)
def test_seconds_of_training_bring_points_nearer_on_pictures_not_trained_on_seed_1(
    pictures: int, steps: int, share: float
) -> None:
    _, training_data = learned_train.training_data(some(1, pictures), 1)
    _, others = learned_train.training_data(some(2, 20), 2)
    before = off(learned_train.make_network("points", np.random.default_rng(1)), others)
    after = off(learned_train.train("points", training_data, steps, 1), others)
    assert before > 10.0
    assert after < share * before


def test_weights_are_the_same_from_file_and_without_them_it_says_what_makes_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "new" / "weights.npz"
    random = np.random.default_rng(1)
    made = learned.Learned(*(learned_train.make_network(name, random) for name in learned.STRIDES), 0.5)
    monkeypatch.setattr(learned, "WEIGHTS", path)
    learned._loaded.cache_clear()
    with pytest.raises(SystemExit, match=r"make them: python examples/learned_train\.py"):
        learned.find(NOTHING)
    learned_train.save(made, path)
    assert path.stat().st_size < 5e6
    read = learned._loaded()
    learned._loaded.cache_clear()
    assert read.sigma == 0.5
    for a, b in zip(made[:2], read[:2], strict=True):
        assert [layer.stride for layer in a] == [layer.stride for layer in b]
        for one, other in zip(learned_train.parameters(a), learned_train.parameters(b), strict=True):
            np.testing.assert_array_equal(one, other)

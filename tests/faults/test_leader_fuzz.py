"""Any sequence of images, whatever their times and points: no exception, and only sound estimates.

A few sequences of each kind; `python -m tests.fuzz` runs as many as you like.
"""

from collections import Counter

import pytest
from msgspec.structs import replace

from onboard.estimators.leader import estimator
from onboard.estimators.leader.hypotheses.belief import BeliefFilter
from onboard.filters.belief import FilterError
from onboard.messages import Exposure
from onboard.ownship import Ownship
from tests import fuzz
from tests.support.cases import slow_but
from tests.support.streams import MS, Flight, S

SEQUENCES = 100  # of each


@pytest.mark.parametrize("name", slow_but(["plain", "delay", fuzz.PAPER], fuzz.NAMES))
def test_no_sequence_of_images_breaks_a_track_seed_7(name: str) -> None:
    count: Counter[str] = Counter()
    for number in range(SEQUENCES):
        count.update(fuzz.run(7, number, name, longest=12))
    met = {
        "fused",
        "duplicate",
        "degenerate",
        "not_finite",
        "too_new",
        "no_pose",
        "tracking",
        "lost",
    }
    if name != fuzz.PAPER:
        met.add("out_of_view")  # the paper's filter knows no edge of an image
    assert met <= set(count), "the fuzz must be of all kinds"


def test_a_filter_that_fails_ends_its_track_and_not_the_program(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise FilterError("process: gave states that are not finite")

    flight = Flight()
    config = replace(fuzz.CONFIGS["middle"], publish_rate_hz=1000.0)
    one, ownship = estimator.Estimator(config, fuzz.CAMERA), Ownship(max_extrapolation=0.1)
    for i in range(3):
        t_ns = 5 * S + i * 20 * MS
        for message in (flight.attitude(t_ns), flight.position(t_ns)):
            ownship.receive(message, t_ns)
        (estimate,) = one.observe(Exposure.of(flight.image(t_ns)), ownship) if i == 1 else one.tick(ownship)
        if i == 1:
            assert estimate.mean is not None
            monkeypatch.setattr(BeliefFilter, "advance", fail)
    assert estimate.mean is None
    assert not estimate.valid
    assert estimate.reason == "the filter failed: process: gave states that are not finite"

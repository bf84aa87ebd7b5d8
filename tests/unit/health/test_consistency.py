"""The noise that a window of innovations shows, against numbers by hand."""

import pytest

from onboard.health.consistency import MIN_INNOVATION_COUNT, Consistencies
from onboard.messages import Consistency, MeasurementReport, Verdict
from tests.support.records import make_estimate


def of_six(nis: float, scale: float) -> Consistency:
    """Of a full window of measurements with six numbers, each with this NIS as a share of its expectation."""
    found = Consistencies()
    for k in range(MIN_INNOVATION_COUNT):
        report = MeasurementReport(
            source="front",
            t_ns=k,
            t_recv_ns=k,
            verdict=Verdict.FUSED,
            innovation=(0.0,) * 6,
            nis=6.0 * nis,
            noise_scale=scale,
        )
        found.add(make_estimate(k, "leader"), report)
    return found.summary()["leader.front"]


@pytest.mark.parametrize(
    ("nis", "scale", "noise"),
    [
        (1.0, 1.0, 1.0),
        (1.44, 1.0, 1.2),
        (1.44, 2.0, 2.4),  # beyond what was learnt
        (0.25, 2.0, 2.0),  # as learnt, though the last ones are smaller
        (0.25, 1.0, 1.0),
    ],
)
def test_the_noise_is_what_was_learnt_times_what_is_left(nis: float, scale: float, noise: float) -> None:
    found = of_six(nis, scale)
    assert found.nis == pytest.approx(nis)
    assert found.noise == pytest.approx(noise)
    assert found.low < 1.0 < found.high


@pytest.mark.parametrize(("offsets", "noise"), [((2.0, 2.0), 1.0), ((2.0, -2.0), 2.0)])
def test_what_stays_from_image_to_image_is_no_noise(offsets: tuple[float, float], noise: float) -> None:
    """A manoeuvre shifts all innovations, noise each of them on its own."""
    found = Consistencies()
    for k in range(MIN_INNOVATION_COUNT):
        e = (offsets[k % 2], offsets[k % 2])
        report = MeasurementReport(
            source="front",
            t_ns=k,
            t_recv_ns=k,
            verdict=Verdict.FUSED,
            innovation=e,
            innovation_sigma=(1.0, 1.0),
            nis=8.0,
        )
        found.add(make_estimate(k, "leader"), report)
    assert found.summary()["leader.front"].noise == pytest.approx(noise)

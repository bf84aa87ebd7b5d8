"""Records with holes and with numbers that are not finite must not stop the live view."""

import math
from pathlib import Path

import msgspec

from onboard.messages import MeasurementReport, OwnPose, Truth, Verdict
from tests.support.view_flight import flight, late_estimate, record_flight, rows_of

NAN = math.nan


CHANGES: list[dict[str, object]] = [
    {"mean": (NAN,) * 9},
    {"mean": (*(1.0,) * 8, NAN)},
    {"mean": (30.0, 0.0, 0.0, NAN, NAN, NAN, NAN, NAN, NAN)},
    {"covariance": ((NAN,) * 9,) * 9},
    {"covariance": ((0.0,) * 9,) * 9},
    {"covariance": tuple(tuple(-1.0 if i == j else 0.0 for i in range(9)) for j in range(9))},
    {"mean": (0.0,) * 9},
    {"mean": None},
    {"covariance": None},
    {"components": (), "units": (), "mean": (), "covariance": ()},
    {"measurement": None},
    {"age": None},
    {"reason": "non-Latin: 見 💡"},
]


def test_no_estimate_stops_the_view(tmp_path: Path) -> None:
    """In one recording, each half a second before one that is whole."""
    records = []
    for k, changes in enumerate(CHANGES):
        t_ns = late_estimate().t_ns + k * 10**9
        odd = msgspec.structs.replace(late_estimate(), t_ns=t_ns, **changes)
        records += [odd, msgspec.structs.replace(late_estimate(), t_ns=t_ns + 500_000_000)]
    rows = rows_of(record_flight(tmp_path / "odd.rrd", records))
    assert rows["/status"] == len(records)


def test_no_measurement_stops_the_view(tmp_path: Path) -> None:
    """Of each verdict, in one recording: one without numbers, then one whose numbers are none."""
    estimate = late_estimate()
    assert estimate.measurement is not None
    records = []
    for k, verdict in enumerate(Verdict):
        t_ns = estimate.t_ns + k * 10**9
        bare = MeasurementReport(source="front", t_ns=t_ns, t_recv_ns=t_ns, verdict=verdict)
        odd = msgspec.structs.replace(
            estimate.measurement,
            t_ns=t_ns + 10**8,
            points=((NAN, 0.0), (0.1, NAN), (0.2, 0.1)),
            predicted_points=((NAN, NAN),) * 3,
            innovation=(NAN, 1.0, 2.0),
            innovation_sigma=(0.0, 1.0, NAN),
            nis=NAN,
        )
        records += [msgspec.structs.replace(estimate, t_ns=r.t_ns, measurement=r) for r in (bare, odd)]
    rows = rows_of(record_flight(tmp_path / "odd.rrd", records))
    assert estimate.measurement.verdict is next(iter(Verdict))
    assert rows["/images"] == len(records) - 1  # what stays as it is has one row
    assert rows["/scene/follower/camera/measured"] == rows["/scene/follower/camera/verdict"] == len(records)


def test_poses_that_are_not_finite_are_left_out(tmp_path: Path) -> None:
    records = list(flight(0.1))
    own = next(r for r in records if isinstance(r, OwnPose))
    truth = next(r for r in records if isinstance(r, Truth))
    odd_own = msgspec.structs.replace(own, r_OF_n=(NAN, 0.0, 0.0))
    no_attitude = msgspec.structs.replace(own, q_nb=(0.0, 0.0, 0.0, 0.0))
    odd_truth = msgspec.structs.replace(truth, r_FL_n=(NAN, 0.0, 0.0), q_nL=(0.0, 0.0, 0.0, 0.0))
    rows = rows_of(record_flight(tmp_path / "odd.rrd", [odd_own, no_attitude, odd_truth]))
    assert rows["/scene/follower"] == 1  # the row that hides it

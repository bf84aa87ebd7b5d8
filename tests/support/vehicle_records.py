"""Published records made by hand: own state, the estimate of another aircraft, and the truth."""

import math
from typing import Any, Final

import numpy as np

from onboard.messages import ClosestApproach, Estimate, Intruder, Lifecycle, NavState, ThreatLevel, Truth

EAST: Final = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))  # nose to the east
LEVEL: Final = (1.0, 0.0, 0.0, 0.0)
ZERO: Final = (0.0, 0.0, 0.0)
APPROACH: Final = ClosestApproach(
    time=12.0,
    time_sigma=0.5,
    distance=50.0,
    distance_sigma=5.0,
    horizontal=40.0,
    vertical=-30.0,
    threat=ThreatLevel.HIGH,
)
INTRUDER: Final = Intruder(
    icao=0x4B1A2C,
    system=None,
    callsign="HBABC",
    squawk=7000,
    emitter=1,
    sources=("adsb",),
    lat_deg=47.4,
    lon_deg=-8.5,
    alt_msl=600.0,
    v_n=(-30.0, 40.0, 2.0),
    approach=APPROACH,
)
TRAFFIC: Final = Estimate(
    name="traffic",
    target="icao/4b1a2c",
    sequence=1,
    t_ns=100_000_000_000,
    state=Lifecycle.TRACKING,
    valid=True,
    reason="by adsb",
    frame="n",
    components=(),
    units=(),
    mean=(0.0,) * 6,
    covariance=None,
    age=1.4,
    reset_count=0,
    intruder=INTRUDER,
)


def nav_state(t_ms: int = 5000, **changed: Any) -> NavState:
    """Our own state, valid, nose to the east, with variances 1 to 12."""
    fields: dict[str, Any] = {
        "name": "own_state",
        "target": "own_state",
        "sequence": 1,
        "t_ns": t_ms * 1_000_000,
        "state": Lifecycle.TRACKING,
        "valid": True,
        "reason": "",
        "frame": "n",
        "components": ("x",) * 12,
        "units": ("m",) * 12,
        "mean": (1.0, 2.0, -3.0, 4.0, 5.0, 6.0, 0.0, 0.0, math.pi / 2, 0.1, 0.2, 0.3),
        "covariance": tuple(map(tuple, np.diag(np.arange(1.0, 13.0)).tolist())),
        "age": 0.1,
        "reset_count": 258,
        "q_nb": EAST,
        "omega_b": (0.1, 0.2, 0.3),
        "origin": (47.0, 8.0, 500.0),
        "layer": None,
        "switch_fraction": 0.0,
        "nis_ratio": 1.0,
        "quality": 87,
    }
    return NavState(**{**fields, **changed})


def truth(t_ns: int, **changed: Any) -> Truth:
    """Both aircraft level and at rest at the origin, the leader of size 2 m."""
    vectors = dict.fromkeys(("r_FL_n", "v_FL_n", "r_OF_n", "v_F_n", "a_F_n", "r_OL_n"), ZERO)
    fields: dict[str, Any] = {**vectors, "size": 2.0, "a_lat": 0.0, "a_long": 0.0, "q_nF": LEVEL, "q_nL": LEVEL}
    return Truth(t_ns=t_ns, **{**fields, **changed})

"""Misprints of De Vivo et al. in the models of radar and GNSS errors, printed and right."""

from collections.abc import Callable
from typing import Final

import numpy as np

from simlink.sensors import gnss, phased_array, troposphere
from studies.report.findings import Misprint


def jamming() -> Misprint:
    """S/(J+N)."""
    radar, seen = phased_array.Radar(jammer_power=0.0), np.array([[10e3, 0.0, np.radians(20)]])
    height, clear, jammed = np.array([3420.0]), np.zeros(1, bool), np.ones(1, bool)
    without = phased_array.signal_to_noise(radar, seen, height, 0.0, clear)[0]
    right = float(phased_array.signal_to_noise(radar, seen, height, 0.0, jammed)[0] / without)
    printed = right / radar.pulse
    return Misprint(
        where="section 5.1.2, S/(J+N)",
        printed="P_p G_t G_r λ² σ … above, without the pulse's duration τ",
        right="P_p τ …, as in eq 46",
        proof="ratio to S/N of eq 46 when the jammer is off: must be 1",
        printed_value=printed,
        right_value=right,
        proven=bool(abs(right - 1) < 1e-12 and printed > 1e4),
    )


def integration() -> Misprint:
    """The integration of pulses."""
    weak, pulses = 0.1, 10
    printed = pulses * weak * weak / (1 + weak)
    coherent = pulses * weak
    ours = float(phased_array.integrated(phased_array.Radar(integration_loss_db=0.0), np.array([weak]))[0])
    return Misprint(
        where="section 5.1.2, (S/N)_CI",
        printed="called coherent",
        right="the formula is that of non-coherent integration; coherently, S/N grows n_p-fold",
        proof="S/N of ten pulses of 0.1 each, without loss: by the formula, and added up with their phases",
        printed_value=printed,
        right_value=coherent,
        proven=bool(abs(ours - printed) < 1e-12 and coherent > 5 * printed),
    )


def multipath() -> Misprint:
    """The multipath's standard deviation."""
    low, high = np.radians([5.0, 85.0])
    printed = float(0.53 * (np.exp(-low / 10) - np.exp(-high / 10)))
    right = float(np.subtract(*gnss.multipath(np.array([low, high]))))
    return Misprint(
        where="section 5.2.2, δ_mp",
        printed="E in radians",
        right="E in degrees",
        proof="how much more, m, at 5 than at 85 degrees of elevation",
        printed_value=printed,
        right_value=right,
        proven=bool(printed < 0.08 and right > 0.3),
    )


def dry_delay() -> Misprint:
    """T_dry."""
    up = np.array([np.pi / 2])
    printed = 2.3 * np.exp(-0.116e-3 * -8000.0)  # z of NED, 8 km up
    right = float(troposphere.delay(up, 8000.0, 45.0, 60.0, 0.0)[0])
    return Misprint(
        where="eq 53, T_dry",
        printed="a e^(−b z) with z of NED, positive down",
        right="a e^(−b h), altitude h = −z",
        proof="dry zenith delay 8 km up, m; 2.3 at sea level",
        printed_value=float(printed),
        right_value=right,
        proven=bool(right < 2.3 < printed),
    )


MISPRINTS: Final[tuple[Callable[[], Misprint], ...]] = (jamming, integration, multipath, dry_delay)

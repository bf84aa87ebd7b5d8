"""A GPS almanac in YUMA format and the positions of its satellites.

The positions follow IS-GPS-200, 20.3.3.5.2.1, with the elements of an almanac only. `data/gps-week-2429.alm` is
the almanac of GPS week 2429 (381 as broadcast, modulo 1024), applicable at 61440 s: 26 July 2026. It was published
by the U.S. Coast Guard's Navigation Center (a work of the U.S. government) and distributed by CelesTrak.
"""

from functools import lru_cache
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from simlink.sensors.arrays import Array
from simlink.sensors.constellation import EARTH_RATE, GRAVITATIONAL_CONSTANT, Satellites

ALMANAC_PATH: Final = Path(__file__).parent / "data" / "gps-week-2429.alm"
KEPLER_ITERATIONS: Final = 8  # each gains at least two digits at these eccentricities
FIELDS: Final = {
    "Eccentricity": "eccentricity",
    "Time of Applicability(s)": "time",
    "Orbital Inclination(rad)": "inclination",
    "Rate of Right Ascen(r/s)": "node_rate",
    "SQRT(A)  (m 1/2)": "root_axis",
    "Right Ascen at Week(rad)": "node",
    "Argument of Perigee(rad)": "perigee",
    "Mean Anom(rad)": "anomaly",
}


class Almanac(NamedTuple):
    """Names and orbital elements (s,) of the healthy satellites.

    Units are rad, rad/s, s of the GPS week, and m^1/2.
    """

    names: tuple[str, ...]
    eccentricity: Array
    time: Array
    inclination: Array
    node_rate: Array
    root_axis: Array
    node: Array
    perigee: Array
    anomaly: Array


def read(text: str) -> Almanac:
    """Parse a YUMA almanac's healthy satellites. Raises ValueError if it is damaged."""
    names, rows = [], []
    for block in text.split("********")[2::2]:
        entries = dict(line.split(":", maxsplit=1) for line in block.splitlines() if ":" in line)
        try:
            row = [float(entries[label]) for label in FIELDS]
            number, health = int(entries["ID"]), int(entries["Health"])
        except (KeyError, ValueError) as error:
            raise ValueError(f"almanac: satellite {entries.get('ID', '?').strip()}: {error}") from error
        if health == 0:
            names.append(f"G{number:02d}")
            rows.append(row)
    if not rows:
        raise ValueError("almanac: it has no healthy satellite")
    return Almanac(tuple(names), *np.array(rows).T)


@lru_cache(maxsize=1)
def load() -> Almanac:
    """The almanac that comes with the package."""
    return read(ALMANAC_PATH.read_text(encoding="ascii"))


def satellites(almanac: Almanac, t: float) -> Satellites:
    """Return positions and velocities (s, 3) in e at `t` seconds of the almanac's GPS week.

    They are in m and m/s; the velocity is relative to the rotating Earth.
    """
    a = almanac
    since = t - a.time
    axis = a.root_axis**2
    motion = np.sqrt(GRAVITATIONAL_CONSTANT / axis**3)
    mean = a.anomaly + motion * since
    E = mean.copy()
    for _ in range(KEPLER_ITERATIONS):
        E -= (E - a.eccentricity * np.sin(E) - mean) / (1.0 - a.eccentricity * np.cos(E))
    flat = np.sqrt(1.0 - a.eccentricity**2)
    # in the orbital plane: towards the perigee, and across
    x, y = axis * (np.cos(E) - a.eccentricity), axis * flat * np.sin(E)
    E_rate = motion / (1.0 - a.eccentricity * np.cos(E))
    x_rate, y_rate = -axis * np.sin(E) * E_rate, axis * flat * np.cos(E) * E_rate
    node_rate = a.node_rate - EARTH_RATE
    node = a.node + node_rate * since - EARTH_RATE * a.time
    along, across = _axes(a.perigee, a.inclination, node)
    position = x[:, None] * along + y[:, None] * across
    velocity = x_rate[:, None] * along + y_rate[:, None] * across
    velocity += node_rate[:, None] * np.column_stack([-position[:, 1], position[:, 0], np.zeros(len(x))])
    return Satellites(position, velocity)


def _axes(perigee: Array, inclination: Array, node: Array) -> tuple[Array, Array]:
    """Unit vectors (s, 3) in e towards the perigee, and 90 degrees further along the orbit."""
    cw, sw, ci, si = np.cos(perigee), np.sin(perigee), np.cos(inclination), np.sin(inclination)
    cn, sn = np.cos(node), np.sin(node)
    along = np.column_stack([cn * cw - sn * ci * sw, sn * cw + cn * ci * sw, si * sw])
    across = np.column_stack([-cn * sw - sn * ci * cw, -sn * sw + cn * ci * cw, si * cw])
    return along, across

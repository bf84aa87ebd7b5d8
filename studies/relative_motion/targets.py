"""Requirements for an estimator that one would fly behind, and whether ours meets them."""

from collections.abc import Mapping, Sequence
from typing import Final

import msgspec

from onboard.messages import Record
from studies.relative_motion.bound import Bound, VariantBound
from studies.relative_motion.formation import M_PER_FT
from studies.relative_motion.scores import Row
from studies.relative_motion.shipped import DELAY, ON_WING
from studies.report.findings import within

Rows = Mapping[str, Row]  # of the judged methods, by variant

CONSISTENT: Final = (9 / 1.5, 9 * 1.5)  # NEES over nine states
ALSO: Final = {DELAY.name: "`delay_sigma_s = 0.15`", ON_WING.name: "`center_on_wing = true`"}
POSITION_AND_VELOCITY: Final = ("position_ft", "velocity_ft_s")
AT_MOST: Final = {
    "a": (("range", "%", "range_percent", 2.2), ("velocity", "ft/s", "velocity_ft_s", 0.40)),
    "b": (("velocity", "ft/s", "velocity_ft_s", 0.5), ("a_lat", "ft/s²", "a_lat_ft_s2", 1.0)),
    "c": (("range", "%", "range_percent", 2.4),),
    "d": (("range", "%", "range_percent", 3.0),),
    "h": (("NEES (9)", "", "nees", 14.0),),
    "k30": (("range", "%", "range_percent", 3.0),),
    "k45": (("range", "%", "range_percent", 4.0),),
    "k60": (("range", "%", "range_percent", 5.5),),
}


class Target(Record, frozen=True, kw_only=True):
    """A required figure: the measured `value` and its bounds (None: open)."""

    variant: str
    what: str
    unit: str
    value: float | None
    at_least: float | None = None
    at_most: float | None = None
    met: bool = False


def judge(rows: Sequence[Row], method: str, bounds: Sequence[VariantBound]) -> tuple[Target, ...]:
    """Return the targets of the variants, judged by this method's rows.

    Those that need a setting beyond the defaults are also judged with it.
    """
    ours = {row.variant: row for row in rows if row.method == method}
    targets: list[Target] = []
    for variant, row in ours.items():
        targets.append(_target(variant, "diverged", "%", row.diverged_percent, at_most=0.0))
        if variant in "abcde":
            targets.append(_target(variant, "NEES (9)", "", _value(row, "nees"), *CONSISTENT))
        for what, unit, quantity, limit in AT_MOST.get(variant, ()):
            targets.append(_target(variant, what, unit, _value(row, quantity), at_most=limit))
        targets += _special(variant, row, ours)
    for row in rows:
        if row.method in ALSO:
            targets += [
                msgspec.structs.replace(t, what=f"{t.what} ({ALSO[row.method]})")
                for t in _special(row.variant, row, ours)
            ]
    bound = next((bound for bound in bounds if bound.variant == "a"), None)
    if bound is not None and "a" in ours:
        targets += _ratios(ours["a"], bound, "Cramer-Rao bound", 1.25)
    return tuple(targets)


def _special(variant: str, row: Row, ours: Rows) -> list[Target]:
    """The targets that are asked of one variant alone."""
    if variant == "a":
        what = "a_lat converged in 95 % of runs"
        return [_target("a", what, "s", row.a_lat_converged_95_s, at_most=1.2)]
    if variant == "d":
        before, during, after = row.position_sigma_ft
        what = "reported position sigma, after 5 s without images / before"
        return [
            _target("d", what, "", during / before, at_least=1.0),
            _target("d", "the same, 10 s later / after 5 s without images", "", after / during, at_most=1.0),
        ]
    if variant == "e":
        return _ratios(row, ours.get("a"), "that of a", 1.03)
    if variant == "g":
        return _ratios(row, ours.get("g-known"), "with right stamps", 1.10)
    if variant == "i":
        what = "true positions inside the 95 % ellipsoid while out of view"
        return [_target("i", what, "%", _value(row, "inside_unseen_percent"), at_least=95.0)]
    if variant == "hover":
        position = _value(row, "position_ft")
        return [
            _target("hover", "position", "m", None if position is None else position * M_PER_FT, at_most=1.0),
            _target("hover", "samples with a valid estimate", "%", _value(row, "valid_percent"), at_least=100.0),
        ]
    return []


def _ratios(row: Row, other: Row | Bound | None, what: str, at_most: float) -> list[Target]:
    """Return position and velocity errors over those of another row or of a bound.

    They are empty if the other row was not flown.
    """
    if other is None:
        return []
    targets = []
    for name in POSITION_AND_VELOCITY:
        value, of = _value(row, name), _value(other, name) if isinstance(other, Row) else getattr(other, name)
        ratio = None if value is None or not of else value / of
        targets.append(_target(row.variant, f"{name.split('_')[0]} error / {what}", "", ratio, at_most=at_most))
    return targets


def _target(
    variant: str,
    what: str,
    unit: str,
    value: float | None,
    at_least: float | None = None,
    at_most: float | None = None,
) -> Target:
    met = within(value, at_least, at_most)
    return Target(variant=variant, what=what, unit=unit, value=value, at_least=at_least, at_most=at_most, met=met)


def _value(row: Row, quantity: str) -> float | None:
    return row.quantities[quantity].value

"""What an estimator one would fly behind must reach, and whether ours does."""

from collections.abc import Callable, Mapping, Sequence
from typing import Final

from onboard.messages import Record
from onboard.studies.relative_motion.table import FT, Limit, Row

Rows = Mapping[str, Row]  # of one method, by variant

CONSISTENT: Final = (9 / 1.5, 9 * 1.5)  # NEES over nine states
SAME: Final = 1.10  # an error "returns to the compensated figure" within this factor
YAWED: Final = {"k30": 3.0, "k45": 4.0, "k60": 5.5}  # range, %


class Target(Record, frozen=True, kw_only=True):
    """A figure that is asked for: measured `value`, and the bounds it is to keep (None: open)."""

    variant: str
    what: str
    unit: str
    value: float | None
    at_least: float | None = None
    at_most: float | None = None
    met: bool = False


def judged(rows: Sequence[Row], methods: Mapping[str, str], limits: Sequence[Limit]) -> tuple[Target, ...]:
    """The targets of the variants, each judged by the method named for it."""
    ours = {row.variant: row for row in rows if row.method == methods.get(row.variant)}
    bound = next((limit for limit in limits if limit.variant == "a"), None)
    targets: list[Target] = []
    for variant, row in ours.items():
        targets += _of_variant(variant, row, ours)
    if bound is not None and "a" in ours:
        for what in ("position_ft", "velocity_ft_s"):
            ratio = _ratio(_value(ours["a"], what), getattr(bound, what))
            targets.append(_target("a", f"{what.split('_')[0]} error / Cramer-Rao bound", "", ratio, at_most=1.25))
    return tuple(targets)


def _of_variant(variant: str, row: Row, ours: Rows) -> list[Target]:
    targets = [_target(variant, "diverged", "%", row.diverged_percent, at_most=0.0)]
    if variant in "abcde":
        low, high = CONSISTENT
        targets.append(_target(variant, "NEES (9)", "", _value(row, "nees"), at_least=low, at_most=high))
    of = {"a": _a, "b": _b, "c": _c, "d": _d, "e": _e, "g": _g, "h": _h, "i": _i, "hover": _hover}
    judge: Callable[[Row, Rows], list[Target]] | None = of.get(variant)
    if variant in YAWED:
        targets.append(_target(variant, "range", "%", _value(row, "range_percent"), at_most=YAWED[variant]))
    return targets + (judge(row, ours) if judge is not None else [])


def _a(row: Row, _: Rows) -> list[Target]:
    return [
        _target("a", "range", "%", _value(row, "range_percent"), at_most=2.2),
        _target("a", "velocity", "ft/s", _value(row, "velocity_ft_s"), at_most=0.40),
        _target("a", "a_lat converged in 95 % of runs", "s", row.a_lat_converged_95_s, at_most=1.2),
    ]


def _b(row: Row, _: Rows) -> list[Target]:
    return [
        _target("b", "velocity", "ft/s", _value(row, "velocity_ft_s"), at_most=0.5),
        _target("b", "a_lat", "ft/s²", _value(row, "a_lat_ft_s2"), at_most=1.0),
    ]


def _c(row: Row, _: Rows) -> list[Target]:
    return [_target("c", "range", "%", _value(row, "range_percent"), at_most=2.4)]


def _d(row: Row, _: Rows) -> list[Target]:
    before, during, after = row.position_sigma_ft
    return [
        _target("d", "range", "%", _value(row, "range_percent"), at_most=3.0),
        _target(
            "d", "reported position sigma, after 5 s without images / before", "", during / before, at_least=1.0
        ),
        _target("d", "the same, 10 s later / after 5 s without images", "", after / during, at_most=1.0),
    ]


def _e(row: Row, ours: Rows) -> list[Target]:
    if "a" not in ours:
        return []
    ratios = [_ratio(_value(row, name), _value(ours["a"], name)) for name in ("position_ft", "velocity_ft_s")]
    return [
        _target("e", f"{name} error / that of a", "", ratio, at_most=1.03)
        for name, ratio in zip(("position", "velocity"), ratios, strict=True)
    ]


def _g(row: Row, ours: Rows) -> list[Target]:
    targets = [
        _target("g", "delay error at 20 s, root mean square", "ms", row.delay_at_20_s_ms, at_most=15.0),
        _target("g", "largest delay error from 20 s on, 95 % of runs", "ms", row.delay_error_ms, at_most=15.0),
    ]
    if "g-known" in ours:
        for name in ("position_ft", "velocity_ft_s"):
            ratio = _ratio(_value(row, name), _value(ours["g-known"], name))
            targets.append(_target("g", f"{name.split('_')[0]} error / compensated", "", ratio, at_most=SAME))
    return targets


def _h(row: Row, _: Rows) -> list[Target]:
    return [_target("h", "NEES (9)", "", _value(row, "nees"), at_most=14.0)]


def _i(row: Row, _: Rows) -> list[Target]:
    inside = _value(row, "inside_unseen_percent")
    return [_target("i", "true positions inside the 95 % ellipsoid while out of view", "%", inside, at_least=95.0)]


def _hover(row: Row, _: Rows) -> list[Target]:
    position = _value(row, "position_ft")
    return [
        _target("hover", "position", "m", None if position is None else position * FT, at_most=1.0),
        _target("hover", "samples with an estimate", "%", _value(row, "told_percent"), at_least=100.0),
    ]


def _target(
    variant: str,
    what: str,
    unit: str,
    value: float | None,
    at_least: float | None = None,
    at_most: float | None = None,
) -> Target:
    met = value is not None and (at_least is None or value >= at_least) and (at_most is None or value <= at_most)
    return Target(variant=variant, what=what, unit=unit, value=value, at_least=at_least, at_most=at_most, met=met)


def _value(row: Row, quantity: str) -> float | None:
    return row.quantities[quantity].value


def _ratio(value: float | None, of: float | None) -> float | None:
    return None if value is None or not of else value / of

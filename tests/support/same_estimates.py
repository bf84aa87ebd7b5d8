"""Whether two tables of estimates are the same, as two processors compute them.

A replay is bit for bit the same on one processor. On another kind, products may be rounded in other places.
`python -m tests.support.same_estimates ONE.csv OTHER.csv`
"""

import csv
import sys
from pathlib import Path

TOLERANCE = 1e-9  # relative, and in the units of each column


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return [*csv.DictReader(file)]


def largest_difference(one: Path, other: Path) -> float:
    """Return the largest difference of all numbers, relative for those above 1.

    Raises ValueError if the tables differ in anything else.
    """
    ones, others = rows(one), rows(other)
    if len(ones) != len(others) or not ones or ones[0].keys() != others[0].keys():
        raise ValueError(f"{len(ones)} rows and {len(others)}, or other columns")
    pairs = ((name, text, b[name]) for a, b in zip(ones, others, strict=True) for name, text in a.items())
    return max(_difference(*pair) for pair in pairs)


def _difference(name: str, one: str, other: str) -> float:
    if one == other:
        return 0.0
    try:
        a, b = float(one), float(other)
    except ValueError:
        raise ValueError(f"{name}: {one} and {other}") from None
    if not abs(a - b) < float("inf"):
        raise ValueError(f"{name}: {one} and {other}")
    return abs(a - b) / max(1.0, abs(a), abs(b))


def main(arguments: list[str]) -> int:
    found = largest_difference(Path(arguments[0]), Path(arguments[1]))
    print(f"{arguments[0]}, {arguments[1]}: the largest difference is {found:.1e} (at most {TOLERANCE:.0e})")
    return int(found > TOLERANCE)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

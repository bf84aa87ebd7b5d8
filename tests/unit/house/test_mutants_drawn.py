"""Mutants that are drawn: which changes there are of a source, which tests are near, and what a share says."""

import pytest

from tests.mutants.changes import changes
from tests.mutants.drawn import interval


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("a <= b", ["a < b"]),
        ("é = a < b", ["é = a <= b"]),  # a column of `ast` counts bytes
        ("a is not b", ["a is b"]),
        ("a not in b", ["a in b"]),
        ("(a) - (b)", ["(a) + (b)"]),
        ("a += b", ["a -= b"]),
        ("a and not b", ["a and b", "a or not b"]),
        ("x = 1", ["x = 0", "x = 2"]),
        ("x = 2.5", ["x = 5.0"]),
        ("x = -a", ["x = +a"]),
        ("x = True", ["x = False"]),
        ("x = np.minimum(a, b)", ["x = np.maximum(a, b)"]),
        ("def f():\n    if a:\n        return b", ["def f():\n    if False:\n        return b"]),
        ("def f(a: Literal[1] | None) -> int: ...", []),
        ("x: Final[int | None] = None", []),
        ("Pair = tuple[1, 2]", []),
        ("isinstance(a, B | C)", []),
        ('"%s" % a', []),
        ("@a(1)\nclass B(C[1], frozen=True): ...", []),
        ("f(a=1 if b else c)", ["f(a=0 if b else c)", "f(a=2 if b else c)"]),
    ],
)
def test_the_changes_of_a_line(text: str, wrong: list[str]) -> None:
    assert sorted(change.applied_to(text) for change in changes(text)) == sorted(wrong)


def test_a_share_is_known_as_well_as_its_number_allows() -> None:
    assert interval(41, 50) == pytest.approx((0.692, 0.902), abs=1e-3)  # Newcombe 1998, method 3
    assert interval(0, 0) == (0.0, 1.0)
    low, high = interval(10, 10)
    assert low == pytest.approx(0.722, abs=1e-3)
    assert high == pytest.approx(1.0)

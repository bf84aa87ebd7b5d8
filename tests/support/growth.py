"""What of the code grows unseen, counted off the sources."""

import ast
from collections import Counter

from tests.support.programs import ROOT

OF_SCORES = ("scoring", "view", "commands")  # there `valid` is a count, or shown


def sets_valid() -> Counter[str]:
    """The files of `onboard` that set `valid` of a record, and at how many places."""
    found: Counter[str] = Counter()
    for path in sorted((ROOT / "onboard").rglob("*.py")):
        name = path.relative_to(ROOT).as_posix()
        if name.split("/")[1] not in OF_SCORES:
            calls = [n for n in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(n, ast.Call)]
            found[name] += sum(keyword.arg == "valid" for call in calls for keyword in call.keywords)
    return +found

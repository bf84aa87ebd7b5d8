"""The table of mutants: each a single wrong line, by name, with the tests that should see it.

[name-of-the-mutant]
file = "onboard/clocks.py"
old = "t_ns=t_ns - delay_ns"          # stands exactly once in the file
new = "t_ns=t_ns + delay_ns"
tests = ["tests/unit/test_clocks.py::test_a_delay_is_taken_off"]
survives = "why no test can see it"   # only of one that is declared to survive
"""

import tomllib
from pathlib import Path
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).parents[2]
FOLDER: Final = Path(__file__).parent


class MutantError(Exception):
    """A mutant cannot be made; the message says why."""


class Mutant(NamedTuple):
    """One wrong line: in `file`, `new` stands for `old`."""

    name: str
    file: str
    old: str
    new: str
    tests: tuple[str, ...]
    survives: str = ""

    def applied_to(self, text: str) -> str:
        """The text with the mutant in it. Raises MutantError unless the old text stands there exactly once."""
        count = text.count(self.old)
        if count != 1:
            raise MutantError(f"{self.name}: the old text stands {count} times in {self.file}, not once")
        return text.replace(self.old, self.new)


def read(folder: Path = FOLDER) -> dict[str, Mutant]:
    """All mutants by name, in the order of the files' names. Raises MutantError."""
    found: dict[str, Mutant] = {}
    for path in sorted(folder.glob("*.toml")):
        for name, entry in tomllib.loads(path.read_text(encoding="utf-8")).items():
            if name in found:
                raise MutantError(f"{path.name}: {name} is there twice")
            try:
                mutant = Mutant(name=name, **entry | {"tests": tuple(entry["tests"])})
            except (KeyError, TypeError) as error:
                raise MutantError(f"{path.name}: {name}: {error}") from error
            if not mutant.tests or mutant.old == mutant.new:
                raise MutantError(f"{path.name}: {name} changes nothing, or no test is named")
            found[name] = mutant
    return found

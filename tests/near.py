"""The test files nearest to changed files, for `make test-near`: those that the table of mutants names for a
source, then those fewest imports away from it; of a test file, itself."""

import subprocess
import sys
from collections.abc import Iterable, Sequence

from tests.mutants.drawn import nearest
from tests.mutants.table import ROOT, Mutant, read


def near(files: Iterable[str], table: Sequence[Mutant]) -> list[str]:
    """Test files for files of ours, by their paths in the repository; none for what no test imports."""
    found = set()
    for file in files:
        is_test = file.startswith("tests/") and file.rpartition("/")[2].startswith("test_")
        found |= {file} if is_test else set(nearest(file, table))
    return sorted(found)


def changed() -> list[str]:
    """The Python files that differ from the last commit, and new ones."""
    listed = [("diff", "--name-only", "--diff-filter=d", "HEAD"), ("ls-files", "--others", "--exclude-standard")]
    lines = [subprocess.check_output(("git", *command), cwd=ROOT, text=True).splitlines() for command in listed]
    return [file for each in lines for file in each if file.endswith(".py")]


if __name__ == "__main__":
    print(*near(sys.argv[1:] or changed(), list(read().values())))

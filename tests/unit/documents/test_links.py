"""Links in the documents lead somewhere: files, headings, and paths of the code."""

import re
from pathlib import Path
from pkgutil import resolve_name

import pytest

from tests.support import documents
from tests.support.programs import ROOT
from tests.unit.house.test_import_rules import FLOORS

CODE = re.compile(r"`((?:onboard|simlink|studies|tests|benchmarks|configs|docs)/[^`\s]*)`")
MADE = {"onboard/estimators/NAME.py"}  # by the reader
PLACEHOLDER = re.compile(r"[<{]")  # keys of Zenoh, as onboard/<vehicle>/alive


def prose(text: str) -> str:
    """A document without its fenced blocks."""
    return re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)


def anchors(path: Path) -> set[str]:
    """The anchors of a page's headings, as GitHub and MyST make them."""
    headings = re.findall(r"^#+ (.*)$", prose(documents.text(path)), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def dead(path: Path) -> list[str]:
    """The links of a document that lead nowhere."""
    found = []
    for target in re.findall(r"\]\((?!https?:)([^)]+)\)", prose(documents.text(path))):
        file, _, anchor = target.partition("#")
        to = path.parent / file if file else path
        if not to.exists() or (anchor and anchor not in anchors(to)):
            found.append(target)
    return found


@pytest.mark.parametrize("path", documents.ALL, ids=documents.name)
def test_every_link_leads_to_a_file_and_a_heading(path: Path) -> None:
    assert dead(path) == []


@pytest.mark.parametrize("path", documents.ALL, ids=documents.name)
def test_every_path_of_the_code_exists(path: Path) -> None:
    for named in CODE.findall(prose(documents.text(path))):
        assert PLACEHOLDER.search(named) or named in MADE or (ROOT / named).exists(), named


@pytest.mark.parametrize("path", documents.ALL, ids=documents.name)
def test_every_dotted_name_of_the_code_exists(path: Path) -> None:
    for named in re.findall(r"`((?:onboard|simlink)(?:\.\w+)+)(?:\(\))?`", prose(documents.text(path))):
        assert resolve_name(named) is not None


def test_every_page_is_in_the_table_of_contents() -> None:
    contents = " ".join(documents.blocks(documents.text("index"), "{toctree}")).split()
    pages = {str(path.relative_to(documents.DOCS).with_suffix("")) for path in documents.DOCS.rglob("*.md")}
    assert pages - {"index"} == pages & set(contents)


def test_the_readme_is_short() -> None:
    assert len(documents.text(ROOT / "README.md").splitlines()) <= 150


@pytest.mark.parametrize("path", documents.ALL, ids=documents.name)
def test_prose_is_wrapped(path: Path) -> None:
    """Rows of tables, pictures and generated parts aside."""
    written = re.sub(r"<!-- schema: begin.*?schema: end -->", "", documents.text(path), flags=re.DOTALL)
    assert not [line for line in written.splitlines() if len(line) > 120 and line[0] not in "|!"]


def test_the_floors_are_those_that_the_test_of_imports_keeps() -> None:
    table, *_ = documents.tables(documents.text(ROOT / "CONTRIBUTING.md"))
    shown = {int(floor): set(documents.names(parts)) for floor, parts in table}
    assert shown == dict(enumerate(FLOORS))

"""The pages about the filters name every filter, every module, and only what there is."""

import re
from pkgutil import iter_modules

import pytest

import onboard.filters
from onboard.filters import families
from tests.support import documents

INNER = {"inline"}  # for kernels and programs, not for readers
MODULES = {found.name for found in iter_modules(onboard.filters.__path__) if not found.name.startswith("_")}


def test_the_table_has_every_filter_and_no_other() -> None:
    named = [name for row in documents.tables(documents.text("choosing"))[0] for name in documents.names(row[0])]
    assert sorted(named) == sorted(families.MODULES)


def test_every_module_is_in_the_reference_once() -> None:
    shown = re.findall(r"automodule:: onboard\.filters\.(\w+)", documents.text("api"))
    assert sorted(shown) == sorted(MODULES - INNER - {"kernels"} - {"errors"} | ({"errors"} & set(shown)))


@pytest.mark.parametrize("page", ["choosing", "notebook"])
def test_what_the_pages_call_is_there(page: str) -> None:
    text = documents.text(page)
    called = set(re.findall(rf"`(?:onboard\.filters\.)?({'|'.join(sorted(MODULES))})\.(\w+)", text))
    assert called
    for module, name in called:
        assert hasattr(getattr(onboard.filters, module), name), f"{module}.{name}"

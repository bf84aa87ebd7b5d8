"""The configuration of Sphinx; `make docs` builds these pages."""

import os
import sys
from pathlib import Path
from typing import Any

os.environ["WINGLINE_KERNELS"] = "python"  # the reference shows the functions, which have no machine code here
sys.path.insert(0, str(Path(__file__).parents[1]))
from onboard import __version__ as release

project = "wingline"
version = release
copyright = "BSD-3-Clause"  # noqa: A001 - Sphinx reads this name
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]
napoleon_google_docstring = False
napoleon_use_param = False  # a shape is no cross-reference
napoleon_custom_sections = [("Attributes", "params_style")]
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}
autodoc_typehints = "signature"
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = f"wingline {release}"
html_show_copyright = False
html_theme_options = {"light_css_variables": {"content-width": "60rem"}}

myst_heading_anchors = 4

default_role = "code"  # the docstrings have Markdown's single backticks


def as_text(_app: object, _what: str, _name: str, _object: object, _options: object, lines: list[str]) -> None:
    """Escape a docstring as plain text for reStructuredText.

    A bar is an absolute value, not a substitution, and a list needs no blank line.
    """
    found: list[str] = []
    for line in lines:
        if line.startswith("- ") and found and found[-1].strip() and not found[-1].startswith(("- ", "  ")):
            found.append("")
        found.append(line.replace("|", r"\|"))
    lines[:] = found


def setup(app: Any) -> None:
    """Connect `as_text`."""
    app.connect("autodoc-process-docstring", as_text)

"""Sphinx: `make docs` builds these pages, with the measured figures of figures.json put in."""

import json
from pathlib import Path

project = "wingline"
copyright = "BSD-3-Clause"  # noqa: A001 - Sphinx reads this name
extensions = ["myst_parser"]
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = "wingline"
html_show_copyright = False
html_theme_options = {"light_css_variables": {"content-width": "60rem"}}

myst_enable_extensions = ["substitution"]
myst_heading_anchors = 4
myst_substitutions = {
    key: value
    for group in json.loads(Path(__file__).with_name("figures.json").read_text(encoding="utf-8")).values()
    for key, value in group.items()
}

"""Sphinx: `make docs` builds these pages."""

project = "wingline"
copyright = "BSD-3-Clause"  # noqa: A001 - Sphinx reads this name
extensions = ["myst_parser"]
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = "wingline"
html_show_copyright = False
html_theme_options = {"light_css_variables": {"content-width": "60rem"}}

myst_heading_anchors = 4

"""How `make docs` makes pages of these documents."""

import re
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import orchestrator  # noqa: E402 - from the clone, whether or not it is installed

project = "Orchestrator"
version = release = orchestrator.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc"]
exclude_patterns = ["_build"]
suppress_warnings = [
    "misc.highlighting_failure",  # "…" in what is shown of YAML and Python
    "ref.python",                 # fields of the same name in several classes
]
myst_heading_anchors = 3
autodoc_member_order = "bysource"
autodoc_typehints = "none"
html_theme = "furo"
html_title = f"Orchestrator {release}"
html_static_path = ["static"]
html_css_files = ["pages.css"]
html_show_sourcelink = False
html_copy_source = False


def with_lists(app, what, name, obj, options, lines):
    """Show lines ``name : meaning`` of a docstring as a list, what it returns or raises as paragraphs of their own."""
    shown = []
    for line in lines:
        item = re.match(r"([\w*, ]+) : (.*)", line)
        if item:
            line = f"- **{item[1]}**: {item[2]}"
        if (item and shown and not shown[-1].startswith(("-", " "))) or re.match(r"(Returns|Raises) ", line):
            shown.append("")
        shown.append(line)
    lines[:] = shown


def setup(app):
    app.connect("autodoc-process-docstring", with_lists)

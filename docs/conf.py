"""How `make docs` makes pages of these documents."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import orchestrator  # noqa: E402 - from the clone, whether or not it is installed

project = "Orchestrator"
version = release = orchestrator.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["_build"]
suppress_warnings = [
    "misc.highlighting_failure",  # "…" in what is shown of YAML and Python
    "ref.python",                 # fields of the same name in several classes
]
myst_heading_anchors = 3
myst_enable_extensions = ["dollarmath"]
myst_fence_as_directive = ["math"]
napoleon_google_docstring = False
autodoc_member_order = "bysource"
autodoc_typehints = "none"
html_theme = "furo"
html_title = f"Orchestrator {release}"
html_static_path: list[str] = []
html_show_sourcelink = False
html_copy_source = False

"""The site of the docs: `make docs` builds it into docs/_build/html."""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

project = "odm"
author = "the odm authors"
copyright = "the odm authors"  # noqa: A001 (Sphinx's name for it)
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build"]

html_theme = "furo"
html_title = "odm: reactive planning beside a moving human"

myst_enable_extensions = ["attrs_inline"]
myst_heading_anchors = 3
# pages also serve where the repository is browsed, and name files of it there
suppress_warnings = [
    "myst.xref_missing",
    "myst.header",
    "misc.highlighting_failure",
    "ref.python",
]

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
napoleon_google_docstring = True
napoleon_use_ivar = True

"""How the documentation site is built: ``make docs``, or ``python -m sphinx -W -b html docs out/site``."""

from __future__ import annotations

import os
import sys
from importlib.metadata import version as version_of
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
os.environ["VIBROSWARM_PLAIN"] = "1"  # kernels as plain functions, with their signatures and docstrings

import docstrings

project = "vibroswarm"
author = "The vibroswarm authors"
copyright = author
version = release = version_of("vibroswarm")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["images"]
suppress_warnings = ["ref.python"]  # two classes of one name, of which an annotation does not say which

myst_heading_anchors = 4
myst_enable_extensions = ["deflist"]

autodoc_typehints_format = "short"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
python_maximum_signature_line_length = 88
python_use_unqualified_type_names = True
add_module_names = False
napoleon_numpy_docstring = False
napoleon_use_rtype = False

# Everything a page needs lies beside it, so that the site works from disk and asks no other host for anything.
html_theme = "furo"
html_title = "vibroswarm"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_show_sphinx = False
html_show_search_summary = False  # summaries are fetched from other pages, which a page from disk may not do


def setup(app: Any) -> None:
    """Docstrings, which are written as plain text, become what Sphinx reads."""
    app.connect("autodoc-process-docstring", docstrings.process, priority=400)

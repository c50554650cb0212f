"""Configuration of the documentation site: ``make docs``, or ``python -m sphinx -W -b html docs out/site``."""

from __future__ import annotations

import os
import sys
from importlib.metadata import version as version_of
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
os.environ["VIBROSWARM_PLAIN"] = "1"  # kernels as plain functions, with their signatures and docstrings

import docstrings
import make_commands
import make_reference

project = "vibroswarm"
author = "The vibroswarm authors"
copyright = author
version = release = version_of("vibroswarm")

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "mathml",
    "symbols",
    "front_page",
    "search_texts",
]
html_math_renderer = "mathml"
source_suffix = {".md": "markdown"}
exclude_patterns = ["images"]
suppress_warnings = ["ref.python"]  # two classes share a name, which makes annotations ambiguous

myst_heading_anchors = 4
myst_enable_extensions = ["deflist", "dollarmath"]
myst_fence_as_directive = ["math"]  # as repositories' pages have it

autodoc_typehints_format = "short"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
python_maximum_signature_line_length = 88
python_use_unqualified_type_names = True
add_module_names = False
napoleon_numpy_docstring = False
napoleon_use_rtype = False

# All files of the site are local, so that it works from disk and without a network.
html_theme = "furo"
html_title = "vibroswarm"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_show_sphinx = False
html_show_search_summary = (
    False  # excerpts are in search_texts.js: browsers do not load other pages from disk
)
html_search_scorer = str(Path(__file__).with_name("search_scorer.js"))


def setup(app: Any) -> None:
    """Write the pages that are made from the sources, and convert plain-text docstrings for Sphinx."""
    for page in (make_reference, make_commands):
        page.TARGET.write_text(page.reference(), encoding="utf-8")
    app.connect("autodoc-process-docstring", docstrings.process, priority=400)

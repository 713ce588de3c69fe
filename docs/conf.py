"""Sphinx configuration: sphinx-build -W -b html docs docs/_build/html."""

from __future__ import annotations

import re

import openmm_dpd

project = "openmm_dpd"
author = "the openmm_dpd developers"
copyright = author  # noqa: A001
release = version = openmm_dpd.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.mathjax"]
myst_enable_extensions = ["dollarmath", "amsmath"]
myst_heading_anchors = 3
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build", "measure"]

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autoclass_content = "class"
napoleon_google_docstring = False
napoleon_numpy_docstring = True
napoleon_use_rtype = False
napoleon_use_ivar = True

html_theme = "alabaster"
html_theme_options = {
    "description": "Dissipative particle dynamics for OpenMM",
    "page_width": "1080px",
    "sidebar_width": "240px",
    "fixed_sidebar": True,
}
html_title = "openmm_dpd"


def escape_bars(app, what, name, obj, options, lines):
    """|x| in a docstring is an absolute value, not a substitution."""
    for number, line in enumerate(lines):
        if "`" not in line and ">>>" not in line:
            lines[number] = re.sub(r"\|(\S(?:[^|]*\S)?)\|", r"\\|\1\\|", line)


def setup(app):
    """Called by Sphinx."""
    app.connect("autodoc-process-docstring", escape_bars)

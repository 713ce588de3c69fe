"""Sphinx configuration: sphinx-build -W -b html docs docs/_build/html."""

from __future__ import annotations

import re

from docutils import nodes
from sphinx.addnodes import pending_xref

import openmm_dpd

project = "openmm_dpd"
author = "the openmm_dpd developers"
copyright = author  # noqa: A001
release = version = openmm_dpd.__version__

# myst_nb reads pages and notebooks; the offline MathJax is a copy of its own, so that mathematics needs no network
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.mathjax", "sphinx-mathjax-offline"]
myst_enable_extensions = ["dollarmath", "amsmath"]
myst_heading_anchors = 3
source_suffix = {".md": "myst-nb", ".ipynb": "myst-nb"}
exclude_patterns = ["_build", "measure"]
nb_execution_mode = "off"  # notebooks show the outputs that are stored in them; a test runs them

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
maximum_signature_line_length = 100  # longer ones have a line for each argument
autoclass_content = "class"
napoleon_google_docstring = False
napoleon_numpy_docstring = True
napoleon_use_rtype = False
napoleon_use_ivar = True

html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["page.css"]
html_title = "openmm_dpd"


def escape_bars(app, what, name, obj, options, lines):
    """|x| in a docstring is an absolute value, not a substitution."""
    for number, line in enumerate(lines):
        if "`" not in line and ">>>" not in line:
            lines[number] = re.sub(r"\|(\S(?:[^|]*\S)?)\|", r"\\|\1\\|", line)


def leave_words(app, doctree):
    """The type of an argument is often a plain word, such as number or path, and no reference to an attribute of that name."""
    for node in list(doctree.findall(pending_xref)):
        if node.get("refspecific") and node["reftype"] in ("class", "obj") and re.fullmatch("[a-z_]+", node["reftarget"]):
            node.replace_self(node.children)


def keep_numbers_whole(app, doctree):
    """A number stays on one line with its per cent or with the sign before it, so that cells of tables break before the error at most."""
    for node in list(doctree.findall(nodes.Text)):
        whole = re.sub(r"(?<=[±<>]) (?=\d)|(?<=\d) (?=%)", "\N{NO-BREAK SPACE}", node)
        if whole != node and not isinstance(node.parent, nodes.literal | nodes.math | nodes.FixedTextElement):
            node.parent.replace(node, nodes.Text(whole))


def setup(app):
    """Called by Sphinx."""
    app.connect("autodoc-process-docstring", escape_bars)
    app.connect("doctree-read", leave_words)
    app.connect("doctree-read", keep_numbers_whole)

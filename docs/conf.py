"""How Sphinx makes the handbook: ``make docs``. What is made from the code is in ``from_code.py``."""

import sys
from pathlib import Path
from pydoc import locate
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE)]

import from_code  # noqa: E402

from cosim import __version__  # noqa: E402

project = "cosim"
author = "the authors of cosim"
copyright = "the authors of cosim, MIT licence"
release = version = __version__
language = "en"

extensions = ["myst_parser", "sphinx.ext.autodoc"]
source_suffix = {".md": "markdown"}
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints = "none"
autodoc_class_signature = "separated"
autodoc_default_options = {"members": True, "show-inheritance": False}

html_theme = "pydata_sphinx_theme"
html_title = f"cosim {release}"
html_static_path = ["_static"]
html_css_files = ["handbook.css"]
# no section to walk through
html_sidebars = {page: [] for page in ("index", "tutorial", "validation", "claims", "architecture")}
html_copy_source = False
html_show_sourcelink = False
html_last_updated_fmt = None
html_theme_options = {
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "navbar_align": "left",
    "navbar_end": ["theme-switcher"],
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "header_links_before_dropdown": 6,
}


def _known(app: Any, env: Any, node: Any, text: Any) -> Any:
    """Link a name as its own module knows it; leave one that exists but has no page as it is. Others are warned of."""
    if node.get("refdomain") != "py":
        return None
    for name in (node["reftarget"], f"{node.get('py:module')}.{node['reftarget']}"):
        found = locate(name)
        if found is not None:
            real = f"{getattr(found, '__module__', '')}.{getattr(found, '__qualname__', '')}"
            where = node.get("refdoc", ""), app.builder, "obj", real, node, text
            return env.domains["py"].resolve_xref(env, *where) or text
    return None


def setup(app: Any) -> None:
    """Have the pages that the code writes filled in as they are read, and names found as their modules know them."""
    app.connect("source-read", from_code.fill)
    app.connect("env-get-outdated", from_code.outdated)
    app.connect("missing-reference", _known)

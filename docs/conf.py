"""Configuration of Sphinx. `make docs` builds the documentation without access to the network.

The pages are Markdown and notebooks, the reference is generated from the docstrings, and the
gallery from programs that are run. Our own extensions of Sphinx are in `_ext/`.
"""

from __future__ import annotations

import sys
from datetime import date
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE / "_ext"), str(HERE.parent)]

from replays import ReplayScraper, in_order  # noqa: E402 - found by the line above

project = "baxter-kin"
author = "the baxter-kin developers"
copyright = f"{date.today().year}, {author}"  # noqa: A001 - Sphinx calls it that

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.githubpages",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_gallery.gen_gallery",
    "docstrings",
    "embedded_notebooks",
    "mathml",
    "replays",
    "public_names",
]
exclude_patterns = ["_ext", "_static", "figures", "gallery", "stories/*.ipynb"]
suppress_warnings = ["config.cache"]  # the scraper and the order of the gallery are objects
nitpicky = True

# Markdown and notebooks
myst_enable_extensions = [
    "amsmath",
    "attrs_block",
    "attrs_inline",
    "colon_fence",
    "deflist",
    "dollarmath",
]
myst_heading_anchors = 4
nb_execution_mode = "off"  # shown as stored
nb_ipywidgets_js: dict[str, dict[str, str]] = {}  # otherwise pages load scripts from two servers
html_math_renderer = "mathml"

# reference
autoclass_content = "both"
autodoc_class_signature = "mixed"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_type_aliases = {name: name for name in ("ArrayLike", "FloatArray", "PathLike")}
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
python_maximum_signature_line_length = 80
python_use_unqualified_type_names = True
default_role = "literal"

# gallery
sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "stories",
    "filename_pattern": r"\.py$",
    "within_subsection_order": in_order,
    "image_scrapers": ("matplotlib", ReplayScraper()),
    "capture_repr": (),
    "download_all_examples": False,
    "show_signature": False,
    "show_memory": False,
    "write_computation_times": False,
    "remove_config_comments": True,
    "only_warn_on_example_error": False,
    "abort_on_example_error": False,
    "copyfile_regex": r".*\.rst$",
}

# the site
html_theme = "furo"
html_title = "baxter-kin"
html_favicon = "_static/icon.svg"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False

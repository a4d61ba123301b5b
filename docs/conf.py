"""How the documentation is built: `make docs`."""

import sys
from pathlib import Path

import dofsim

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

project = "dofsim"
author = "the dofsim developers"
version = release = dofsim.__version__
html_title = "dofsim"

extensions = ["myst_nb", "numpydoc", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "mathml", "commands"]
exclude_patterns = ["*.py", "_ext"]
templates_path: list[str] = []
nitpicky = False

myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3

# Notebooks are text, and run anew at every build: what a page shows is what this version gives.
nb_execution_mode = "force"
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_execution_show_tb = True
# Widgets would need scripts from elsewhere: pages show the picture that is left where scripts do not run.
nb_ipywidgets_js: dict[str, dict[str, str]] = {}
nb_mime_priority_overrides = [("html", "application/vnd.jupyter.widget-view+json", None)]
nb_merge_streams = True

autodoc_typehints = "none"
# Gigabytes that a page of documentation can do without.
autodoc_mock_imports = ["torch", "torchvision"]
autosummary_generate = False
numpydoc_show_class_members = False
numpydoc_xref_param_type = False
# Docstrings name parameters, and objects of dofsim, between single backticks.
default_role = "code"

# Mathematics is MathML, which needs neither scripts nor fonts from elsewhere.
html_math_renderer = "mathml"

html_theme = "pydata_sphinx_theme"
html_static_path = ["_static"]
html_css_files = ["dofsim.css"]
# Only the pages that have others beside them need the column on the left.
_alone = (
    "index",
    "install",
    "troubleshooting",
    "tutorial",
    "optics",
    "gallery",
    "performance",
    "promises",
    "architecture",
    "genindex",
    "search",
)
html_sidebars: dict[str, list[str]] = {name: [] for name in _alone}
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "navbar_align": "left",
    "header_links_before_dropdown": 6,
    "show_toc_level": 2,
    "show_prev_next": True,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "pygments_light_style": "tango",
    "pygments_dark_style": "monokai",
}
copyright = "the dofsim developers; MIT or Apache 2.0"

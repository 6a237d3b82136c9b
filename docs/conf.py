"""The documentation site: `make docs`, then open build/docs/index.html; it needs no network.

The source folder of Sphinx is that of the repository, so that a page may link to any file in it, as on a
forge. The pages are those that docs/README.md lists.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "extensions"))

project = "soro"
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "equations",
    "four_parts",
    "mermaid",
    "notebook",
    "reference",
]
root_doc = "README"
include_patterns = [
    "*.md",
    "docs/**.md",
    "bags/*.md",
    "benchmarks/*.md",
    "config/**.md",
    "examples/**.md",
    "examples/*.ipynb",
    "tests/apparatus/*.md",
]
exclude_patterns = [".*", "build", "runs", "*.egg-info", "lib", "soro_*"]

# Anchors of headings as on a forge.
myst_heading_anchors = 6
myst_fence_as_directive = ["math", "mermaid"]
# Equations are LaTeX between dollars or in a fence `math`, as on a forge.
myst_enable_extensions = ["dollarmath"]
html_math_renderer = "mathml"
# Listings are plain text: no page states a language that is guessed wrong.
highlight_language = "none"
# Two dashes before an option stay two.
smartquotes = False

html_theme = "furo"
html_title = "soro"
html_copy_source = False
html_show_sphinx = False
html_static_path = ["static"]
html_css_files = ["wide.css"]
html_additional_pages = {"index": "index.html"}
templates_path = ["templates"]

# Docstrings are numpydoc, whose single backticks are names.
default_role = "code"
napoleon_google_docstring = False
napoleon_use_ivar = True
autodoc_default_options = {"members": True, "exclude-members": "model_config"}
autodoc_typehints = "none"
toc_object_entries = False
# Shapes such as (n_q,) are taken for names, of which there can be several.
suppress_warnings = ["ref.python"]

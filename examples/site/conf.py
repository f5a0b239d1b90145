"""Settings of the documentation site: `python -m sphinx -W --keep-going -b html examples/site build/site`."""

import sys
from importlib.util import find_spec
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parents[1])]

project = "inc_casadi"
author = "the authors of inc_casadi"
html_title = "inc_casadi"
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.viewcode", "site_directives", "site_docstrings", "site_notebooks"]
if find_spec("math_core"):
    extensions.append("site_math")
    html_math_renderer = "mathml"  # formulas need no network; without math-core MathJax comes from its usual host

source_suffix = {".rst": "restructuredtext", ".md": "myst-nb", ".ipynb": "myst-nb"}
exclude_patterns = ["README.md"]
nb_execution_mode = "off"  # notebooks are stored with what they printed, and a test runs them again
myst_enable_extensions = ["amsmath", "deflist", "dollarmath"]
myst_heading_anchors = 3
highlight_language = "python"
smartquotes = False  # x'P x is a product, not an apostrophe

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_type_aliases = {"ArrayLike": "ArrayLike", "Array": "Array"}
autodoc_default_options = {"members": True}
python_maximum_signature_line_length = 90
python_use_unqualified_type_names = True

html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_copyright = False

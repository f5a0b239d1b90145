"""Formulas as MathML, written when the site is built: pages need neither a network nor JavaScript to show them.

The translation from TeX is that of `math_core`. It refuses commands that it does not know, which stops a strict build.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import math_core
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.locale import _
from sphinx.util import logging
from sphinx.util.math import get_node_equation_number

LOGGER = logging.getLogger(__name__)
RENDERER = "mathml"


@cache
def mathml(formula: str, displayed: bool) -> str:
    r"""Return a formula in TeX as MathML; raises math_core.LatexError when it is not understood.

    >>> mathml(r"\beta<1", False)
    '<math><mi>β</mi><mo>&lt;</mo><mn>1</mn></math>'
    """
    return str(math_core.LatexToMathML().convert_with_local_state(formula, displaystyle=displayed))


def shown(node: nodes.Node, formula: str, displayed: bool) -> str:
    """Return the MathML of a node, or its TeX as code, with a warning that says where it stands."""
    try:
        return mathml(formula.strip(), displayed)
    except math_core.LatexError as error:
        LOGGER.warning("the formula %s is not understood: %s", formula.strip(), error, location=node)
        return f"<code>{formula.replace('&', '&amp;').replace('<', '&lt;')}</code>"


def inline(writer: Any, node: nodes.math) -> None:
    """Write a formula in a line."""
    writer.body.append(shown(node, node.astext(), False))
    raise nodes.SkipNode


def displayed(writer: Any, node: nodes.math_block) -> None:
    """Write a formula on lines of its own, with its number if it has one."""
    writer.body.append(writer.starttag(node, "div", CLASS="math notranslate nohighlight"))
    if node["number"]:
        writer.body.append(f'<span class="eqno">({get_node_equation_number(writer, node)})')
        writer.add_permalink_ref(node, _("Link to this equation"))
        writer.body.append("</span>")
    writer.body += [shown(node, node.astext(), True), "</div>\n"]
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the renderer."""
    app.add_html_math_renderer(RENDERER, (inline, None), (displayed, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}

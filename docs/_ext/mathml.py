"""Formulas as MathML, which browsers render without a script from a server.

Docutils translates the LaTeX; what it does not know is a warning, so an error of `make docs`.
"""

from __future__ import annotations

import html
import re
from typing import Any

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging

LOGGER = logging.getLogger(__name__)

OTHER_WORDS = (
    (re.compile(r"\\dots\b"), r"\\ldots"),
    (re.compile(r"(\\[td]?frac)\s*(\d)(\d)"), r"\1{\2}{\3}"),
    (re.compile(r"\\(begin|end)\{(?:align|gather|equation)\*?\}"), r"\\\1{aligned}"),
    (re.compile(r"\\(begin|end)\{array\}(?:\{[lcr|]*\})?"), r"\\\1{matrix}"),
)
"""Commands that docutils knows under other names."""


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the renderer "mathml"."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}


def _inline(translator: Any, node: nodes.math) -> None:
    translator.body.append(_mathml(node, is_block=False))
    raise nodes.SkipNode


def _block(translator: Any, node: nodes.math_block) -> None:
    number = f'<span class="eqno">({node["number"]})</span>' if node.get("number") else ""
    anchor = f' id="{node["ids"][0]}"' if node.get("ids") else ""
    formula = _mathml(node, is_block=True)
    translator.body.append(f'<div class="formula"{anchor}>{number}{formula}</div>\n')
    raise nodes.SkipNode


def _mathml(node: nodes.Element, *, is_block: bool) -> str:
    code = node.astext()
    for pattern, word in OTHER_WORDS:
        code = pattern.sub(word, code)
    try:
        drawn = str(tex2mathml(code, as_block=is_block))
    except MathError as error:
        LOGGER.warning("cannot draw the formula %r: %s", code, error, location=node)
        return f"<code>{html.escape(code)}</code>"
    return drawn.replace("<mo>‖</mo>", '<mo stretchy="false">‖</mo>')  # both bars alike

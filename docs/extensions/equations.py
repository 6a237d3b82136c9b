r"""Equations of the pages as MathML, which a browser typesets itself: no script, no network.

The pages write LaTeX between dollars or in a fence ``math``, as GitHub shows it. docutils, which Sphinx
brings, converts it, and refuses what it does not know.
"""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.errors import ExtensionError

TAG = re.compile(r"\s*\\tag\{([^}]*)\}")
# docutils would put the index of a letter with an accent below that letter.
ACCENT = re.compile(r"(\\(?:ddot|dot|hat|bar|tilde) ?(?:\\[a-zA-Z]+|\w|\{[^{}]*\}))(?=_)")


def mathml(text: str, *, as_block: bool) -> str:
    """Convert an equation.

    Parameters
    ----------
    text : str
        LaTeX, without a number.
    as_block : bool
        Whether the equation has lines of its own.

    Raises
    ------
    sphinx.errors.ExtensionError
        For a command that the converter does not know.
    """
    try:
        return str(tex2mathml(ACCENT.sub(r"\1{}", text), as_block=as_block))
    except (MathError, SyntaxError) as error:
        raise ExtensionError(f"equation {text!r}: {error}") from error


def numbered(text: str) -> str:
    r"""Return an equation as a block, with the number of its ``\tag`` at the right."""
    tag = TAG.search(text)
    equation = mathml(TAG.sub("", text), as_block=True)
    if tag is None:
        return f'<div class="equation">{equation}</div>'
    number = f'<span class="number">({tag[1]})</span>'
    return f'<div class="equation" id="equation-{tag[1]}">{equation}{number}</div>'


def visit_inline(writer: Any, node: nodes.math) -> None:
    """Write an equation within a sentence."""
    writer.body.append(mathml(node.astext(), as_block=False))
    raise nodes.SkipNode


def visit_block(writer: Any, node: nodes.math_block) -> None:
    """Write an equation between paragraphs."""
    writer.body.append(numbered(node.astext()))
    raise nodes.SkipNode


def setup(app: Any) -> dict[str, bool]:
    """Extend Sphinx."""
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}

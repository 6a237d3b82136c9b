"""Diagrams of the pages, drawn at build time by Mermaid itself: the reader's browser needs no network."""

from __future__ import annotations

import base64
from typing import Any

import mermaidx
from docutils import nodes
from docutils.parsers.rst import Directive


class Mermaid(Directive):
    """A fence ``mermaid``; a reader without pictures gets its text."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        """Return the picture."""
        text = "\n".join(self.content)
        drawn = mermaidx.render(text).svg()
        data = base64.b64encode(drawn.encode()).decode()
        image = nodes.image(uri=f"data:image/svg+xml;base64,{data}", alt=text)
        return [nodes.figure("", image, classes=["diagram"])]


def setup(app: Any) -> dict[str, bool]:
    """Extend Sphinx."""
    app.add_directive("mermaid", Mermaid)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

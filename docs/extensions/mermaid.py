"""Diagrams of the pages, drawn at build time by Mermaid itself: the reader's browser needs no network."""

from __future__ import annotations

import base64
import re
from typing import Any

import mermaidx
from docutils import nodes
from docutils.parsers.rst import Directive

# The widest diagram of the pages just fits.
SCALE = 0.48


class Mermaid(Directive):
    """A fence ``mermaid``; a reader without pictures gets its text."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        """Return the picture."""
        text = "\n".join(self.content)
        drawn = mermaidx.render(text).svg()
        data = base64.b64encode(drawn.encode()).decode()
        # Drawn as wide as its words need; the page lets a wide one scroll.
        width = float(re.search(r'viewBox="\S+ \S+ (\S+)', drawn)[1])  # type: ignore[index]
        size = f"{SCALE * width:.0f}px"
        image = nodes.image(uri=f"data:image/svg+xml;base64,{data}", alt=text, width=size)
        return [nodes.figure("", image, classes=["diagram"])]


def setup(app: Any) -> dict[str, bool]:
    """Extend Sphinx."""
    app.add_directive("mermaid", Mermaid)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

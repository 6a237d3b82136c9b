"""Notebooks as pages: their text as Markdown, their code, and the outputs that are stored in them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from docutils import nodes
from myst_parser.parsers.sphinx_ import MystParser


class NotebookParser(MystParser):
    """Parser of .ipynb files, format 4."""

    supported = ("ipynb",)

    def parse(self, inputstring: str, document: nodes.document) -> None:
        """Parse a notebook as the page that it looks like."""
        cells = json.loads(inputstring)["cells"]
        super().parse("\n\n".join(part for cell in cells for part in _parts(cell)), document)


def _parts(cell: dict[str, Any]) -> Iterator[str]:
    text = "".join(cell["source"])
    if cell["cell_type"] == "markdown":
        yield text
        return
    yield f"```python\n{text}\n```"
    for output in cell["outputs"]:
        if printed := "".join(output.get("text", ())):
            yield f"```\n{printed}```"
        if picture := output.get("data", {}).get("image/png"):
            image = f'<img alt="a picture of this cell" src="data:image/png;base64,{picture}">'
            yield f"```{{raw}} html\n{image}\n```"


def setup(app: Any) -> dict[str, bool]:
    """Extend Sphinx."""
    app.add_source_parser(NotebookParser)
    app.add_source_suffix(".ipynb", "ipynb")
    return {"parallel_read_safe": True, "parallel_write_safe": True}

"""Pages of the reference, written from the code before the site is built."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from reference import api, commands, keys, nodes

HEAD = "# {title}\n\n{about} This page is generated from the code.\n\n"


def write(app: Any) -> None:
    """Write the pages into docs/generated; a page that has not changed keeps its time."""
    folder = Path(app.srcdir) / "docs" / "generated"
    folder.mkdir(exist_ok=True)
    linked: list[type] = []
    pages = {**commands.pages(), **keys.pages(linked), **nodes.pages(), **api.pages()}
    app.connect("autodoc-process-docstring", partial(api.show_fields, linked))
    for name, (title, about, body) in pages.items():
        page, text = folder / f"{name}.md", HEAD.format(title=title, about=about) + body
        if not page.exists() or page.read_text(encoding="utf-8") != text:
            page.write_text(text, encoding="utf-8")


def setup(app: Any) -> dict[str, bool]:
    """Extend Sphinx."""
    app.connect("builder-inited", write)
    app.connect("autodoc-process-docstring", api.escape)
    app.connect("autodoc-skip-member", api.skip)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

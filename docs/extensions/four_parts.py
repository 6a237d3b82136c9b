"""The pages as the site needs them: a sidebar as docs/README.md has it, and no links to folders."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

PART = re.compile(r"^## (.+?):.*?$(.*?)(?=^## |\Z)", re.MULTILINE | re.DOTALL)
PAGE = re.compile(r"\]\(([^)#\s]+\.(?:md|ipynb))[)#]")
# Pages that the site alone has, by part; they are generated from the code.
GENERATED = {
    "Reference": (
        "commands",
        "topics",
        "parameters",
        "scene_keys",
        "robot_keys",
        "part_keys",
        "task_keys",
        "platform_keys",
        "api",
    )
}
MORE = ("docs/README", "CHANGELOG")
DECISIONS = "docs/adr/README"
LINK = re.compile(r"\[([^\]]*)\]\(([^)\s:#]+)\)")


def toctree(pages: list[str], caption: str = "") -> str:
    """Return a hidden table of contents as MyST."""
    listed = "\n".join(f"/{page}" for page in pages)
    title = f":caption: {caption}\n" if caption else ""
    return f"\n```{{toctree}}\n:hidden:\n{title}\n{listed}\n```\n"


def parts(index: Path, root: Path) -> dict[str, list[str]]:
    """Return the pages of each part, as Sphinx names them.

    Parameters
    ----------
    index : Path
        The page that lists all pages.
    root : Path
        Source folder of the site.
    """
    found = {}
    for part, text in PART.findall(index.read_text(encoding="utf-8")):
        pages = [(index.parent / page).resolve().relative_to(root) for page in PAGE.findall(text)]
        generated = [f"docs/generated/{name}" for name in GENERATED.get(part, ())]
        found[part] = [*dict.fromkeys(str(page.with_suffix("")) for page in pages), *generated]
    return found


def append(app: Any, docname: str, source: list[str]) -> None:
    """Append tables of contents to the first page and to the list of decisions, as they are read."""
    root = Path(app.srcdir).resolve()
    if docname == app.config.root_doc:
        listed = parts(root / "docs" / "README.md", root)
        source[0] += "".join(toctree(pages, part) for part, pages in listed.items())
        source[0] += toctree(list(MORE), "More")
    if docname == DECISIONS:
        decisions = sorted((root / "docs" / "adr").glob("0*.md"))
        source[0] += toctree([f"docs/adr/{page.stem}" for page in decisions])


def unlink_folders(app: Any, docname: str, source: list[str]) -> None:
    """Leave the words of links to folders, which a forge lists and a site has not."""
    folder = app.env.doc2path(docname).parent
    source[0] = LINK.sub(lambda link: link[1] if (folder / link[2]).is_dir() else link[0], source[0])


def setup(app: Any) -> dict[str, bool]:
    """Extend Sphinx."""
    app.connect("source-read", unlink_folders)
    app.connect("source-read", append)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

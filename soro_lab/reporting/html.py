"""A page of a report: chapters of words, tables and pictures, which one template makes HTML."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template

from soro_lab.reporting.drawing import Image


@dataclass(frozen=True)
class Cell:
    """A cell of a table that is not of words alone.

    Attributes
    ----------
    text : str
    path : str
        Place of its number in report.json, with points; empty of a cell of words.
    factor : float
        What the number there is multiplied by to be shown.
    is_bad : bool
    is_number : bool
        Whether it is set as a number although it has no place.
    """

    text: str
    path: str = ""
    factor: float = 1.0
    is_bad: bool = False
    is_number: bool = False


@dataclass(frozen=True)
class Heading:
    """A heading inside a chapter."""

    text: str


@dataclass(frozen=True)
class Words:
    """A paragraph; `kind` is empty, soft or warn."""

    text: str
    kind: str = ""


@dataclass(frozen=True)
class Bullets:
    """A list of lines."""

    lines: Sequence[str]


@dataclass(frozen=True)
class Table:
    """A table; a heading that begins with # is one of numbers."""

    head: Sequence[str]
    rows: Sequence[Sequence[Cell | str]]


@dataclass(frozen=True)
class Picture:
    """A picture; `text` says what it shows, for a reader who does not see it."""

    image: Image
    text: str
    caption: str = ""


@dataclass(frozen=True)
class Folded:
    """A text as it is, shown on demand."""

    text: str


Block: TypeAlias = Heading | Words | Bullets | Table | Picture | Folded


@dataclass(frozen=True)
class Chapter:
    """A chapter; `key` is its address in the page."""

    key: str
    title: str
    blocks: Sequence[Block]


@dataclass(frozen=True)
class Page:
    """A page, in the order in which it is read.

    Attributes
    ----------
    title : str
    source : str
        What the page is about, in one line.
    verdict : str
    is_good : bool
        Whether the verdict is.
    notes : sequence of blocks
        Below the verdict.
    chapters : sequence of Chapter
    """

    title: str
    source: str
    verdict: str
    is_good: bool
    notes: Sequence[Block]
    chapters: Sequence[Chapter]

    @property
    def html(self) -> str:
        """The page as one file that needs no network."""
        return _template().render(page=self)

    @property
    def pictures(self) -> Iterator[Picture]:
        """Its pictures in order."""
        blocks = (block for chapter in self.chapters for block in chapter.blocks)
        return (block for block in blocks if isinstance(block, Picture))


@cache
def _template() -> Template:
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template("page.jinja")


def number(
    value: float | None, path: str, factor: float = 1.0, digits: int = 3, is_bad: bool = False
) -> Cell | str:
    """Return a cell of a number that stands in report.json; a dash of one that does not exist.

    Parameters
    ----------
    value : float or None
        As it stands there.
    path : str
        Where it stands.
    factor : float
        From there to the unit that is shown.
    digits : int
        That are shown.
    is_bad : bool
        Whether it is a warning.
    """
    if value is None:
        return "–"
    shown = factor * value
    text = f"{shown:.0f}" if 10**digits <= abs(shown) < 1e6 else f"{shown:.{digits}g}"
    return Cell(text, path, factor, is_bad)


def write(page: Page, content: dict[str, Any], folder: Path) -> Path:
    """Write index.html, its numbers as report.json, and its pictures as files; return the page.

    Parameters
    ----------
    page : Page
    content : dict
        All numbers of the page.
    folder : Path
        Made where it does not exist.
    """
    pictures = folder / "pictures"
    pictures.mkdir(parents=True, exist_ok=True)
    text = json.dumps(content, indent=1, allow_nan=False) + "\n"
    (folder / "report.json").write_text(text, encoding="utf-8")
    (folder / "index.html").write_text(page.html, encoding="utf-8")
    for picture in page.pictures:  # under a name of what it shows
        name = re.sub(r"\W+", "_", picture.text.lower()).strip("_")
        (pictures / f"{name}.{picture.image.ending}").write_bytes(picture.image.data)
    return folder / "index.html"

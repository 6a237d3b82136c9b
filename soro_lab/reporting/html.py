"""Parts of the page: cells with the place of their number in report.json, tables, pictures, the frame."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from string import Template

PAGE = Template("""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>$title</title>
<style>
:root { --ink: #1f2933; --soft: #5f6c7b; --line: #dde3ea; --good: #2e7d4f; --bad: #b3392f; }
* { box-sizing: border-box; }
body { margin: 2.2rem auto; max-width: 62rem; padding: 0 1.4rem; color: var(--ink); background: #fff;
  font: 15px/1.5 "Helvetica Neue", Helvetica, Arial, "DejaVu Sans", sans-serif; }
h1 { font-size: 1.55rem; margin: 0 0 .2rem; }
h2 { font-size: 1.12rem; margin: 2.4rem 0 .5rem; padding-top: .5rem; border-top: 1px solid var(--line); }
h3 { font-size: .98rem; margin: 1.4rem 0 .3rem; }
p { margin: .4rem 0; } ul { margin: .3rem 0; padding-left: 1.2rem; }
.soft, figcaption { color: var(--soft); font-size: .86rem; }
.verdict { border-left: 5px solid var(--bad); background: #fbf3f2; padding: .7rem 1rem;
  margin: 1rem 0; font-size: 1.05rem; }
.verdict.good { border-color: var(--good); background: #f1f8f3; }
.warn { color: var(--bad); font-weight: 600; }
nav a { color: var(--soft); margin-right: .9rem; font-size: .86rem; white-space: nowrap; }
.table { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-size: .83rem; margin: .5rem 0; }
th { text-align: left; font-weight: 600; border-bottom: 1.5px solid var(--ink);
  padding: .25rem .6rem .25rem 0; vertical-align: bottom; }
td { border-bottom: 1px solid var(--line); padding: .22rem .6rem .22rem 0; vertical-align: top; }
td:first-child { white-space: nowrap; }
td.n, th.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
figure { margin: .8rem 0 1.2rem; } figure img { max-width: 100%; height: auto; display: block; }
code, pre { font-size: .9em; } pre { overflow-x: auto; }
@page { size: A4; margin: 14mm; }
@media print { body { margin: 0; max-width: none; font-size: 10.5pt; padding: 0; } nav { display: none; }
  .table { overflow: visible; } table { font-size: 7.6pt; } tr, figure { break-inside: avoid; }
  figure img { max-height: 250mm; } h2, h3 { break-after: avoid; } }
</style>
</head>
<body>
$body
</body>
</html>
""")


@dataclass(frozen=True)
class Cell:
    """A cell of a table.

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

    @property
    def html(self) -> str:
        """The element."""
        data = f' data-path="{escape(self.path)}" data-factor="{self.factor!r}"' if self.path else ""
        text = f'<span class="warn">{escape(self.text)}</span>' if self.is_bad else escape(self.text)
        return f"<td{' class=n' if self.path or self.is_number else ''}{data}>{text}</td>"


def number(
    value: float | None, path: str, factor: float = 1.0, digits: int = 3, is_bad: bool = False
) -> Cell:
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
        return Cell("–")
    shown = factor * value
    text = f"{shown:.0f}" if 10**digits <= abs(shown) < 1e6 else f"{shown:.{digits}g}"
    return Cell(text, path, factor, is_bad)


def table(head: Sequence[str], rows: Iterable[Sequence[Cell]]) -> str:
    """Return a table; a heading that begins with # is one of numbers.

    Parameters
    ----------
    head : sequence of str
    rows : iterable of sequences of Cell
    """
    titles = "".join(
        f"<th class=n>{escape(name[1:])}</th>" if name.startswith("#") else f"<th>{escape(name)}</th>"
        for name in head
    )
    body = "\n".join("<tr>" + "".join(cell.html for cell in row) + "</tr>" for row in rows)
    return (
        f'<div class="table"><table><thead><tr>{titles}</tr></thead><tbody>\n{body}\n</tbody></table></div>'
    )


def picture(address: str, text: str, caption: str = "") -> str:
    """Return a figure.

    Parameters
    ----------
    address : str
        Image, as data.
    text : str
        What it shows, for a reader who does not see it.
    caption : str
    """
    below = f"<figcaption>{escape(caption)}</figcaption>" if caption else ""
    return f'<figure><img alt="{escape(text)}" src="{address}">{below}</figure>'


def bullets(lines: Iterable[str]) -> str:
    """Return a list."""
    return "<ul>" + "".join(f"<li>{escape(line)}</li>" for line in lines) + "</ul>"


def words(*lines: str, kind: str = "") -> str:
    """Return paragraphs."""
    return "".join(f"<p{f' class={kind}' if kind else ''}>{escape(line)}</p>" for line in lines)

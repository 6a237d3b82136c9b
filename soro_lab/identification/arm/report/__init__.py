"""The report of an identification: a page that needs no network, its numbers as report.json, its pictures."""

from __future__ import annotations

import json
from pathlib import Path

from soro_lab.identification.arm.report.content import Result, content_of
from soro_lab.identification.arm.report.files import write_pictures
from soro_lab.identification.arm.report.page import page
from soro_lab.identification.arm.report.traces import traces

__all__ = ["PAGE", "Result", "write_report"]

PAGE = "index.html"


def write_report(result: Result, folder: Path) -> Path:
    """Write index.html, report.json and the folder pictures; return the page.

    Parameters
    ----------
    result : Result
    folder : Path
        Made where it does not exist.
    """
    seen = traces(result.found)
    content = content_of(result, seen)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "report.json").write_text(
        json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8"
    )
    text = page(content, seen)
    (folder / PAGE).write_text(text, encoding="utf-8")
    write_pictures(text, folder / "pictures")
    return folder / PAGE

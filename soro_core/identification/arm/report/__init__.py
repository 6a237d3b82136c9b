"""The report of an identification: index.html, which needs no network, and its numbers as report.json."""

from __future__ import annotations

import json
from pathlib import Path

from soro_core.identification.arm.report.content import Result, content_of
from soro_core.identification.arm.report.page import page
from soro_core.identification.arm.report.traces import traces

__all__ = ["PAGE", "Result", "write_report"]

PAGE = "index.html"


def write_report(result: Result, folder: Path) -> Path:
    """Write index.html and report.json; return the page.

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
    (folder / PAGE).write_text(page(content, seen), encoding="utf-8")
    return folder / PAGE

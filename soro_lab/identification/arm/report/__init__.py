"""The report of an identification: a page that needs no network, its numbers as report.json, its pictures."""

from __future__ import annotations

from pathlib import Path

from soro_lab.identification.arm.report.content import ReportContent, content_of
from soro_lab.identification.arm.report.page import page_of
from soro_lab.identification.arm.report.traces import traces
from soro_lab.reporting.html import write

__all__ = ["ReportContent", "write_report"]


def write_report(result: ReportContent, folder: Path) -> Path:
    """Write index.html, report.json and pictures into a folder, created if missing; return the page."""
    seen = traces(result.found)
    content = content_of(result, seen)
    return write(page_of(content, seen), content, folder)

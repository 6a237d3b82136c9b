"""What is written: sections of Markdown in RESULTS.md, each with its own date."""

from __future__ import annotations

import datetime
import importlib.metadata
import os
import platform
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from soro_core._jit import source_hash

HEAD = """# Results

Written by `make bench`; what each section measures is in README.md. One thread on one core, float64, medians
of repeats taken in turns. Absolute times move with the machine; ratios within a section do not.
"""


def table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Markdown table."""
    lines = [" | ".join(header), " | ".join("---" for _ in header)]
    lines += [" | ".join(str(cell) for cell in row) for row in rows]
    return "\n".join(f"| {line} |" for line in lines)


def figure(value: float, digits: int = 3) -> str:
    """Number with that many significant digits, without an exponent where that is readable."""
    if value == 0.0 or 1e-3 <= abs(value) < 1e5:
        text = f"{value:.{digits}g}"
        return f"{float(text):g}" if "e" in text else text
    return f"{value:.{max(digits - 2, 0)}e}"


def met(good: bool) -> str:
    """Mark of a target."""
    return "met" if good else "missed"


def machine(share: float | None) -> str:
    """Where and when, with which versions, and the part of the core that timed calls had."""
    timed = "" if share is None else f"; {100 * share:.0f} % of the core while timing"
    versions = ", ".join(
        f"{name} {_version(name)}" for name in ("numpy", "numba", "soromox", "jax", "diffrax")
    )
    return (
        f"{datetime.datetime.now().astimezone():%Y-%m-%d %H:%M %Z}; {_processor()}, {os.cpu_count()} cores, "
        f"{platform.system()} {platform.release()}; Python {platform.python_version()}, "
        f"soro {_version('soro')} (kernels {source_hash()}), {versions}{timed}."
    )


def write(path: Path, sections: dict[str, str], head: str = HEAD) -> None:
    """Write the sections below `head`; those of an earlier run that were not measured again stay."""
    kept = _read(path)
    kept.update(sections)
    path.write_text(head + "".join(f"\n## {title}\n\n{text.strip()}\n" for title, text in kept.items()))


def _read(path: Path) -> dict[str, str]:
    if not path.exists():
        return {}
    parts = re.split(r"^## (.+)$", path.read_text(), flags=re.MULTILINE)
    return dict(zip(parts[1::2], (text.strip() for text in parts[2::2]), strict=True))


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return "absent"


def _processor() -> str:
    cpuinfo = Path("/proc/cpuinfo")
    for line in cpuinfo.read_text().splitlines() if cpuinfo.exists() else []:
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()

"""Design of soft parts: each part of the section by its own module."""

from __future__ import annotations

from benchmarks import design_topology
from benchmarks.options import Options

TITLE = "Design"
PARTS = (design_topology,)


def run(options: Options) -> str:
    """Return all parts, each under its title."""
    return "\n\n".join(f"### {part.TITLE}\n\n{part.run(options)}" for part in PARTS)

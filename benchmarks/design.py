"""Design of soft parts: finite elements against closed forms and published forces, and how long they take."""

from __future__ import annotations

from collections.abc import Callable

from benchmarks import design_fem
from benchmarks.options import Options

TITLE = "Design with finite elements"

# Each part measures and returns its title and its text.
PARTS: tuple[Callable[[Options], tuple[str, str]], ...] = (
    design_fem.closed_forms,
    design_fem.paths_and_motion,
    design_fem.three_bellow_part,
    design_fem.times,
)


def run(options: Options) -> str:
    """Measure and write."""
    parts = [part(options) for part in PARTS]
    return "\n\n".join(f"### {title}\n\n{text}" for title, text in parts)

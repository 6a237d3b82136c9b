"""Design of soft parts: finite elements, topology optimisation, robots made of parts, and their times."""

from __future__ import annotations

from collections.abc import Callable

from benchmarks import design_fem, design_identified, design_solid, design_topology
from benchmarks.options import Options

TITLE = "Design"

# Each part measures and returns its title and its text.
PARTS: tuple[Callable[[Options], tuple[str, str]], ...] = (
    design_fem.closed_forms,
    design_fem.paths_and_motion,
    design_fem.three_bellow_part,
    design_topology.topology,
    design_solid.solid,
    design_identified.identified,
)


def run(options: Options) -> str:
    """Measure and write."""
    parts = [part(options) for part in PARTS]
    return "\n\n".join(f"### {title}\n\n{text}" for title, text in parts)

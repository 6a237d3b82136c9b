"""Draw the pictures of docs/parts.md: two rods of silicone and a finger, pulled and under pressures.

python -m docs.part_pictures [--folder docs/images]
"""

from __future__ import annotations

import argparse
from pathlib import Path

from soro_design.parts.file import load_part
from soro_design.parts.picture import draw_shapes
from soro_design.parts.specimen import make_specimen
from soro_design.parts.sweeps import follow

SHOWN = {
    "silicone_rod_three_chambers": ("pull", "all", "one"),
    "tapered_rod_three_chambers": ("all", "one", "two"),
    "finger_over_table": ("blown", "lifted"),
}


def main() -> None:
    """Draw it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--folder", type=Path, default=Path("docs/images"))
    folder = parser.parse_args().folder
    for name, shown in SHOWN.items():
        file = load_part(name)
        specimen = make_specimen(file)
        sweeps = [sweep for sweep in file.sweeps if sweep.name in shown]
        shapes = {
            sweep.name: (specimen, follow(specimen, sweep, lambda state: None).last.u) for sweep in sweeps
        }
        draw_shapes(folder / f"{name}.png", shapes)


if __name__ == "__main__":
    main()

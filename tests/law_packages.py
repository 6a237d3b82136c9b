"""The laws of examples/, found as those of installed packages are: by entry point, on the path of Python."""

from __future__ import annotations

import tomllib
from pathlib import Path

from soro_core.control.laws.registry import GROUP

EXAMPLES = Path(__file__).parents[1] / "examples"
# Laws by name, with the folders of their packages.
FOLDERS = {"energy_shaping": EXAMPLES / "energy_shaping", "predictive": EXAMPLES / "predictive"}


def paths_of(law: str, folder: Path) -> list[str]:
    """Return what makes the package of a law importable; writes into a folder what an installation would."""
    project = tomllib.loads((FOLDERS[law] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    name, version = project["name"], project["version"]
    facts = folder / f"{name.replace('-', '_')}-{version}.dist-info"
    facts.mkdir(parents=True)
    (facts / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    points = [f"{one} = {value}" for one, value in project["entry-points"][GROUP].items()]
    (facts / "entry_points.txt").write_text("\n".join([f"[{GROUP}]", *points, ""]))
    return [str(FOLDERS[law]), str(folder)]

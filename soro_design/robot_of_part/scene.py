"""Platform and scene beside the robot file of a part, as `soro new` writes them."""

from __future__ import annotations

import re
from pathlib import Path

from soro_design.robot_of_part.stages import PartIdentification
from soro_lab.scaffold import ArmSetting, Noted, write_setting


def beside(out: Path) -> tuple[Path, Path]:
    """Return the platform file and the scene file beside a robot file."""
    return out.with_name(f"{out.stem}_platform.yaml"), out.with_name(f"{out.stem}_scene.yaml")


def write_scene(found: PartIdentification, out: Path) -> tuple[list[Path], list[str]]:
    """Write platform and scene of a written robot file; its reference holds the pressures of the sweeps.

    Returns
    -------
    list of Path
        The files.
    list of str
        What the numbers of the robot make unlikely to work, a line each.

    Raises
    ------
    ConfigError
        If the robot does not fit the platform.
    """
    known, files = found.known, beside(out)
    arm = ArmSetting(
        name=re.sub(r"[^a-z0-9_]", "_", out.stem.lower()),
        chambers=(known.chambers,),
        pressure_range=Noted(known.pressure_range_pa, "Pa gauge, of the sweeps of the part"),
        command="soro identify-fem",
        mode="lockstep",
    )
    _, warnings = write_setting(arm, out.parent, (out.name, *(file.name for file in files)))
    return list(files), list(warnings)

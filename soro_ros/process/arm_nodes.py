"""The nodes of one arm and their parameters, from the arguments of the launch file.

The python of `ros2 launch` need not have the packages of soro: this module imports none.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

# The regulator starts last: its watchdog waits for commands from then on.
LAST = "regulator"


def valves_command(platform: str, folder: Path) -> list[str]:
    """Return the options of `soro emulate` for emulated valves with their links in `folder`."""
    return [platform, "--device-link", str(folder / "valves"), "--plant-link", str(folder / "plant")]


def parameters_of(robot: str, platform: str, device: str, folder: Path) -> dict[str, dict[str, Any]]:
    """Return the parameters of each node of an arm, by the name of the node, in the order of their start.

    Parameters
    ----------
    robot : str
        Robot file, or the name of a shipped one.
    platform : str
        Platform file or name; empty for a twin in the place of valves.
    device : str
        Port or address of real valves; empty for emulated ones.
    folder : Path
        Folder of the links of emulated valves.
    """
    loop: dict[str, dict[str, Any]] = {
        "estimator": {"robot": robot},
        "controller": {"robot": robot, "platform": platform},
    }
    if not platform:
        return {"twin": {"robot": robot}} | loop
    if device:
        return loop | {LAST: {"platform": platform, "device": device}}
    twin = {"robot": robot, "pressures": "valves", "plant_link": str(folder / "plant")}
    return {"twin": twin} | loop | {LAST: {"platform": platform, "device": str(folder / "valves")}}

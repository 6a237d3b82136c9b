"""Shim for colcon, and the list of files that `ros2 run` and `ros2 launch` look for under share/ and lib/."""

import sys
from pathlib import Path

from setuptools import Distribution, setup

HERE = Path(__file__).parent


def files(folder: str, target: str) -> list[tuple[str, list[str]]]:
    """Every file below `folder`, to be installed under `target` with the same layout."""
    found: dict[str, list[str]] = {}
    for path in sorted((HERE / folder).rglob("*")):
        if path.is_file() and "__pycache__" not in path.parts:
            relative = path.relative_to(HERE)
            found.setdefault(f"{target}/{relative.parent}", []).append(str(relative))
    return list(found.items())


class RosDistribution(Distribution):
    """Editable installs drop data files unless the distribution says that it has them."""

    def has_data(self) -> bool:
        return True


distribution = setup(
    distclass=RosDistribution,
    # Nodes that colcon installs run in the virtual environment that is active, whichever python builds them.
    options={"build_scripts": {"executable": "/usr/bin/env python3"}},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/soro_ros"]),
        # The last three: `colcon build --symlink-install` builds from links to the files of this list alone.
        ("share/soro_ros", ["package.xml", "pyproject.toml", "README.md", "LICENSE"]),
        *files("config", "share/soro_ros"),
        *files("params", "share/soro_ros"),
        ("share/soro_ros/launch", ["soro_ros/launch/arm.launch.py"]),
        *[("lib/soro_ros", [str(p.relative_to(HERE))]) for p in sorted((HERE / "lib/soro_ros").glob("*"))],
    ],
)
if "--dry-run" in sys.argv:  # colcon reads the attributes back from their text; a version range has none
    distribution.python_requires = distribution.metadata.python_requires = None

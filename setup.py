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


options: dict[str, object] = {}
if "--dry-run" in sys.argv:  # colcon's dry run chokes on requires-python
    options["python_requires"] = None

setup(
    distclass=RosDistribution,
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/soro_ros"]),
        ("share/soro_ros", ["package.xml"]),
        *files("config", "share/soro_ros"),
        *[("lib/soro_ros", [str(p.relative_to(HERE))]) for p in sorted((HERE / "lib/soro_ros").glob("*"))],
    ],
    **options,
)

"""`make tf2_msgs`: build the messages of /tf against the ROS wheels, which do not have them; for the tests.

The one message of the package that /tf takes, in a package of the same name, so that its type and its hash
are those of every other ROS. cmake and a C++ compiler build it with the generators of the wheels, which an
environment of their own holds, into the environment that runs this.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

# What the CMake files of the wheels ask for; the release is that of the environment that runs this.
WHEELS = (
    *("ament-cmake", "ament-cmake-gmock", "ament-cmake-gtest", "ament-cmake-include-directories"),
    *("ament-cmake-pytest", "ament-cmake-ros", "ament-index-python", "ament-package", "domain-coordinator"),
    *("fastrtps-cmake-module", "geometry-msgs", "python-cmake-module", "rosidl-core-generators"),
    *("rosidl-default-generators", "rosidl-typesupport-fastrtps-c", "rosidl-typesupport-fastrtps-cpp"),
    "rpyutils",
)
# Headers of Python and numpy on the machine that built the wheels, in their CMake files; CMake finds ours.
DEAD = re.compile(r'"/opt/python/[^"]*"')

CMAKE = """
cmake_minimum_required(VERSION 3.20)
project(tf2_msgs)
find_package(ament_cmake REQUIRED)
find_package(geometry_msgs REQUIRED)
find_package(rosidl_default_generators REQUIRED)
rosidl_generate_interfaces(${PROJECT_NAME} "msg/TFMessage.msg" DEPENDENCIES geometry_msgs)
ament_package()
"""
PACKAGE = """
<package format="3">
  <name>tf2_msgs</name>
  <version>0.0.0</version>
  <description>The message of /tf, for the tests of soro.</description>
  <maintainer email="nobody@example.org">The soro developers</maintainer>
  <license>MIT</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <buildtool_depend>rosidl_default_generators</buildtool_depend>
  <depend>geometry_msgs</depend>
  <exec_depend>rosidl_default_runtime</exec_depend>
  <member_of_group>rosidl_interface_packages</member_of_group>
</package>
"""
MESSAGE = "geometry_msgs/TransformStamped[] transforms\n"


def build(generators: Path, prefix: Path) -> None:
    """Build the package with the generators of one environment, and install it under a prefix."""
    python = generators / "bin" / "python"
    if not python.exists():
        # The wheels start each Python of their environment anew, by what these variables say of this one.
        _call(sys.executable, "-m", "venv", generators)
    _call(python, "-m", "pip", "install", "--quiet", "catkin_pkg", *(f"ros-jazzy-{name}" for name in WHEELS))
    for file in (generators / "share").rglob("*.cmake"):
        text = file.read_text(encoding="utf-8")
        if DEAD.search(text):
            file.write_text(DEAD.sub('""', text), encoding="utf-8")
    with tempfile.TemporaryDirectory() as name:
        source = Path(name)
        (source / "msg").mkdir()
        for path, text in (
            ("CMakeLists.txt", CMAKE),
            ("package.xml", PACKAGE),
            ("msg/TFMessage.msg", MESSAGE),
        ):
            (source / path).write_text(text.lstrip(), encoding="utf-8")
        environment = {
            "PATH": f"{generators / 'bin'}:{os.environ['PATH']}",
            "LD_LIBRARY_PATH": str(generators / "lib"),
            "AMENT_PREFIX_PATH": str(generators),
        }
        _call(
            *("cmake", "-S", source, "-B", source / "build", "-DBUILD_TESTING=OFF"),
            *(f"-DCMAKE_PREFIX_PATH={generators}", f"-DCMAKE_INSTALL_PREFIX={prefix}"),
            f"-DPython3_EXECUTABLE={python}",
            **environment,
        )
        _call("cmake", "--build", source / "build", "--target", "install", "--parallel", "2", **environment)


def _call(*command: str | Path, **environment: str) -> None:
    kept = {
        k: v for k, v in os.environ.items() if k not in ("LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")
    }
    done = subprocess.run(
        [str(word) for word in command],
        env={**kept, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        sys.exit(f"{done.stdout}{done.stderr}\nmake tf2_msgs: failed: {' '.join(map(str, command[:4]))} ...")


def main() -> None:
    """Build it, or say what is missing."""
    parser = argparse.ArgumentParser(prog="make tf2_msgs", description=__doc__.splitlines()[0])
    parser.add_argument("--generators", type=Path, default=Path(".venv-tf2_msgs"), help="environment to make")
    parser.add_argument("--prefix", type=Path, default=Path(sys.prefix), help="where it is installed")
    options = parser.parse_args()
    if missing := [name for name in ("cmake", "c++") if shutil.which(name) is None]:
        sys.exit(f"make tf2_msgs: no {' and no '.join(missing)}; install the packages cmake and g++")
    build(options.generators.resolve(), options.prefix.resolve())
    print(f"tf2_msgs is installed in {options.prefix}")


if __name__ == "__main__":
    main()

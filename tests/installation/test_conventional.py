"""What a conventional ROS 2 installation brings: rosdep by package.xml, pip by the line of the README."""

import ast
import re
import shlex
import tomllib
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from packaging.requirements import Requirement

from soro_core.extras import PACKAGES

ROOT = Path(__file__).resolve().parents[2]
KNOWN = yaml.safe_load((Path(__file__).parent / "rosdep_noble.yaml").read_text())
DEPENDS = {
    element.text: element.tag
    for element in ElementTree.parse(ROOT / "package.xml").getroot()
    if element.tag.endswith("depend")
}
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def imported():
    """Every package that soro_ros imports, wherever in a file, launch files too."""
    found = set()
    for path in (ROOT / "soro_ros").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module] if isinstance(node, ast.ImportFrom) else []
            found |= {name.partition(".")[0] for name in names}
    return found


def requirements():
    """Requirements of the extra `all`, without the wheels of ROS."""
    extras = PROJECT["optional-dependencies"]
    lines = [*PROJECT["dependencies"], *extras["hardware"], *extras["ros"]]
    return [Requirement(line) for line in lines if not line.startswith("ros-jazzy-")]


def pip_line():
    """Requirements that the README gives to pip beside a system's ROS."""
    section = (ROOT / "README.md").read_text().partition("## In a conventional ROS 2 installation")[2]
    line = re.search(r"^pip install (.*?[^\\])$", section, re.MULTILINE | re.DOTALL).group(1)
    return [Requirement(word) for word in shlex.split(line.replace("\\\n", " "), comments=True)]


def test_rosdep_knows_every_dependency():
    assert set(DEPENDS) <= set(KNOWN["ros"]) | set(KNOWN["python"])


@pytest.mark.parametrize("name", sorted(imported() & ({*KNOWN["ros"]} | {*PACKAGES["ros"]})))
def test_every_imported_package_of_ros_is_a_dependency(name):
    if name not in {one.name for one in requirements()}:  # those come from pip
        assert DEPENDS.get(name) == "exec_depend"


@pytest.mark.parametrize("wanted", requirements(), ids=lambda wanted: wanted.name)
def test_every_requirement_comes_from_ubuntu_or_from_the_line_for_pip(wanted):
    key = next((key for key, known in KNOWN["python"].items() if known["index"] == wanted.name), None)
    if key in DEPENDS:
        assert wanted.specifier.contains(KNOWN["python"][key]["release"])
    else:
        (given,) = [one for one in pip_line() if one.name == wanted.name]
        assert given.specifier == wanted.specifier


def test_the_line_for_pip_asks_for_nothing_else():
    assert {one.name for one in pip_line()} <= {one.name for one in requirements()}

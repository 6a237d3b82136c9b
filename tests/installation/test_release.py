"""A release: what states its version and its people, and what its files hold."""

import email
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from itertools import chain
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

from soro_core.jobs.versions import versions
from tests.installation.source_tree import ROOT, copy_sources

TABLES = tomllib.loads((ROOT / "pyproject.toml").read_text())
PROJECT = TABLES["project"]
BOARD = tomllib.loads((ROOT / "board/pyproject.toml").read_text())["project"]
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
PACKAGE = ElementTree.parse(ROOT / "package.xml")
RELEASES = re.findall(r"^## (\S+)(?: \((.+)\))?$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)

# Calls a hook of the backend that pip calls, with the setuptools that is installed: nothing is downloaded.
BUILD = "import sys; from setuptools import build_meta; print(getattr(build_meta, sys.argv[1])(sys.argv[2]))"


def test_every_file_states_the_version_of_pyproject():
    assert [name for name, _ in RELEASES[:2]] == ["Unreleased", PROJECT["version"]]
    assert CITATION["version"] == PROJECT["version"]
    assert BOARD["version"] == PROJECT["version"]
    assert PACKAGE.findtext("version") == PROJECT["version"]


def test_changelog_and_citation_state_the_same_day():
    assert RELEASES[1][1] == str(CITATION["date-released"])


@pytest.mark.process
def test_the_command_prints_the_version():
    command = [sys.executable, "-m", "soro_ros.cli", "--version"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == f"soro {PROJECT['version']}\n"


def test_a_recording_notes_the_version_of_its_sources():
    assert versions()["soro"] == PROJECT["version"]


def test_people_and_address_are_those_of_the_citation():
    def name(one):
        return one.get("name") or f"{one['given-names']} {one['family-names']}"

    assert [one["name"] for one in PROJECT["authors"]] == [name(one) for one in CITATION["authors"]]
    people = [(one.text, one.get("email")) for one in PACKAGE.iter("maintainer")]
    assert people == [(name(one), one["email"]) for one in CITATION["contact"]]
    assert PROJECT.get("urls", {}).get("Repository") == CITATION.get("repository-code")


def build(hook, source, target):
    """Build a file of the sources in a folder by a hook of setuptools; return its path."""
    target.mkdir(exist_ok=True)
    command = [sys.executable, "-W", "ignore", "-c", BUILD, hook, str(target)]
    done = subprocess.run(command, cwd=source, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return target / done.stdout.splitlines()[-1]


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    pytest.importorskip("setuptools", "70.1", reason="older setuptools make no wheels alone")
    folder = tmp_path_factory.mktemp("release") / "soro"
    copy_sources(folder)
    (folder / "tests").mkdir()
    (folder / "tests/test_one.py").touch()
    return folder


@pytest.mark.process
def test_the_wheel_that_is_built_from_the_sdist_has_every_file(sources, tmp_path):
    with tarfile.open(build("build_sdist", sources, tmp_path / "dist")) as archive:
        archive.extractall(tmp_path, filter="data")
    (unpacked,) = tmp_path.glob("soro-*")
    assert not (unpacked / "tests").exists()
    wheel = build("build_wheel", unpacked, tmp_path / "dist")
    assert wheel.name == f"soro-{PROJECT['version']}-py3-none-any.whl"
    with zipfile.ZipFile(wheel) as archive:
        held = archive.namelist()
        about = email.message_from_bytes(
            archive.read(next(n for n in held if n.endswith("dist-info/METADATA")))
        )
        packages = archive.read(next(n for n in held if n.endswith("top_level.txt"))).decode().split()
    assert about["Version"] == PROJECT["version"]
    share = f"soro-{PROJECT['version']}.data/data/share/soro_ros"
    asked = [
        (path, path.relative_to(sources)) for package in packages for path in (sources / package).rglob("*")
    ]
    asked += [
        (path, Path(share) / path.relative_to(sources))
        for path in chain((sources / "config").rglob("*"), (sources / "params").rglob("*"))
    ]
    wanted = {str(name) for path, name in asked if path.is_file() and "__pycache__" not in path.parts}
    assert wanted - set(held) == set()


@pytest.mark.process
def test_type_checkers_outside_the_checkout_see_an_editable_installation(sources, tmp_path):
    """Mypy and pyright read the paths of .pth files; they run no import hook."""
    wheel = build("build_editable", sources, tmp_path / "dist")
    environment = tmp_path / "environment"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", environment], check=True)
    (installed,) = environment.glob("lib/python*/site-packages")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(installed)
    lines = [line for file in installed.glob("*.pth") for line in file.read_text().splitlines()]
    assert lines == [str(sources)]
    pytest.importorskip("mypy", reason="mypy is not installed")
    code = "\n".join(f"import {package}" for package in TABLES["tool"]["mypy"]["packages"])
    options = ["--follow-imports=skip", "--config-file=", "--cache-dir=/dev/null"]
    command = ["mypy", *options, f"--python-executable={environment}/bin/python", "-c", code]
    done = subprocess.run([sys.executable, "-m", *command], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr

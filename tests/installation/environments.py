"""Fresh environments in which soro runs: `make newest`, and `.ci/run` beside the tests.

For each Python that pyproject.toml allows and this machine has, one with the newest packages; and one with
the lowest that pyproject.toml states, on the oldest of them. In each the wheel is installed, tests of the
model run on the installed package, and `soro run` in lockstep in an empty folder. Each environment compiles
its own kernels, in a folder of its own.
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import chain, pairwise
from pathlib import Path
from typing import NamedTuple

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

from tests.installation.source_tree import ROOT, copy_sources
from tests.ros_domain import free_domain

LONGEST_S = 1500.0
"""For one command, on a machine that does other work [s]."""
RUN = ("run", "track_circle", "--set", "mode=lockstep", "--set", "duration_s=2")
# The first compiles what the nodes need, and takes its time: `soro run` waits three minutes for its nodes.
TESTS = (
    "tests/soro_core/loop/test_closed_loop.py::test_the_main_job",
    *(f"tests/soro_core/model/test_model_{name}.py" for name in ("nodes", "golden", "statics")),
)
TOOLS = ("pytest", "pytest-timeout", "hypothesis")
SHOWN = ("numpy", "scipy", "numba", "pydantic", "typer", "mcap")
# What the ROS wheels of the environment that starts this one have set, and what would bring in its packages.
FOREIGN = ("LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE", "PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV")


class Environment(NamedTuple):
    """An environment to make: its name, its Python, requirements of pip that pin packages or raise them."""

    name: str
    python: Path
    constraints: tuple[str, ...] = ()
    beyond: tuple[str, ...] = ()


class FailedError(Exception):
    """A command ended with another status than 0; the text is the end of its output."""


def lowest(lines: Iterable[str]) -> tuple[str, ...]:
    """Return the constraints of pip that pin each requirement to the lowest release that it states."""
    pins = []
    for one in map(Requirement, lines):
        pins += [f"{one.name}=={bound.version}" for bound in one.specifier if bound.operator == ">="]
    return tuple(pins)


def requirements(project: dict) -> list[str]:
    """Return the lines of pyproject.toml's dependencies, those of its extras with them."""
    return [*project["dependencies"], *chain.from_iterable(project["optional-dependencies"].values())]


def find_pythons(allowed: str) -> dict[str, Path | None]:
    """Look up an interpreter that can make environments for each release of Python that is allowed."""
    minors = [f"3.{k}" for k in range(8, 30) if f"3.{k}.99" in SpecifierSet(allowed)]
    return {minor: next(filter(_makes_environments, _candidates(minor)), None) for minor in minors}


def _candidates(minor: str) -> list[Path]:
    on_path = shutil.which(f"python{minor}")
    of_pyenv = sorted(Path.home().glob(f".pyenv/versions/{minor}.*/bin/python3"))
    return [*([Path(on_path)] if on_path else []), *of_pyenv, Path(f"/usr/bin/python{minor}")]


def _makes_environments(python: Path) -> bool:
    command = [python, "-c", "import ensurepip, venv"]
    try:
        return subprocess.run(command, env=_environ(), capture_output=True).returncode == 0
    except OSError:
        return False


def _environ(**more: str) -> dict[str, str]:
    return {**{name: value for name, value in os.environ.items() if name not in FOREIGN}, **more}


def _call(command: Sequence[str | Path], folder: Path, **more: str) -> str:
    """Run a command in a folder and return its output."""
    done = subprocess.run(
        command,
        cwd=folder,
        env=_environ(**more),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=LONGEST_S,
    )
    if done.returncode != 0:
        end = "\n".join(done.stdout.splitlines()[-60:])
        raise FailedError(f"{' '.join(map(str, command))}\nended with {done.returncode}:\n{end}")
    return done.stdout


def _install(one: Environment, wheel: Path, folder: Path) -> Path:
    """Make the environment, and return the folder of its commands."""
    _call([one.python, "-m", "venv", "environment"], folder)
    commands = folder / "environment/bin"
    pip = [commands / "python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    pins = folder / "constraints.txt"
    pins.write_text("\n".join(one.constraints))
    tools = [line for line in requirements(_project()) if Requirement(line).name in TOOLS]
    _call([*pip, "--constraint", pins, f"{wheel}[all]", *tools], folder)
    if one.beyond:
        _call([*pip, "--upgrade", *one.beyond], folder)
    return commands


def _try(one: Environment, wheel: Path) -> str:
    """Make one environment and use it; return a line that says what it had, and how long each step took."""
    with tempfile.TemporaryDirectory(prefix="soro-newest-") as name:
        folder = Path(name)
        empty = folder / "empty"
        empty.mkdir()
        own = {"XDG_CACHE_HOME": str(folder / "cache"), "XDG_STATE_HOME": str(folder / "state")}
        started = [time.monotonic()]
        commands = _install(one, wheel, folder)
        asked = f"from importlib.metadata import version as v; print(*(f'{{p}} {{v(p)}},' for p in {SHOWN}))"
        packages = _call([commands / "python", "-c", asked], empty)
        started.append(time.monotonic())
        # Appended: the package that is tested is the installed one, not that of the repository.
        options = ["-q", "-p", "no:cacheprovider", "--import-mode=append", f"--rootdir={ROOT}"]
        options += [f"--timeout={LONGEST_S}"]
        # Newer packages below the lowest ones warn of what they will not offer any more.
        options += ["-W", "ignore::DeprecationWarning"] if one.constraints else []
        said = _call([commands / "pytest", *options, *(ROOT / test for test in TESTS)], empty, **own)
        started.append(time.monotonic())
        _run_in_lockstep(commands, empty, own)
        started.append(time.monotonic())
        passed = re.findall(r"^\d+ passed.*(?= in )", said, re.MULTILINE)[-1]
        install, tests, run = (f"{b - a:.0f} s" for a, b in pairwise(started))
        return f"{packages.strip()} {passed} (install {install}, tests {tests}, run {run})"


def _run_in_lockstep(commands: Path, folder: Path, own: dict[str, str]) -> None:
    """Run a scene; an imaginary part that is dropped, or a NaN from finite numbers, fails it."""
    with free_domain() as number:
        own = {**own, "ROS_DOMAIN_ID": str(number), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        _call([commands / "soro", *RUN], folder, PYTHONWARNINGS="error::RuntimeWarning", **own)


def _project() -> dict:
    return tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def main() -> int:
    """Try every environment, two at a time; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.partition(":")[0])
    parser.add_argument("--only", default="", help="part of the names, such as 3.12 or lowest")
    parser.add_argument("--beyond", nargs="*", default=[], help="packages to raise past the limits of soro")
    given = parser.parse_args()
    project = _project()
    pythons = find_pythons(project["requires-python"])
    for minor in (minor for minor, python in pythons.items() if python is None):
        print(f"Python {minor}: not on this machine")
    found = {minor: python for minor, python in pythons.items() if python is not None}
    environments = [
        Environment(f"newest packages, Python {minor}", python, beyond=tuple(given.beyond))
        for minor, python in found.items()
    ]
    oldest = next(iter(found), "")
    if oldest and oldest == next(iter(pythons)):  # later ones have no wheels of the lowest releases
        pins = lowest(requirements(project))
        environments.append(Environment(f"lowest packages, Python {oldest}", found[oldest], pins))
    environments = [one for one in environments if given.only in one.name]
    started, failed = time.monotonic(), 0
    with tempfile.TemporaryDirectory(prefix="soro-wheel-") as name:
        copy_sources(Path(name, "soro"))
        build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", name, "./soro"]
        _call(build, Path(name))
        (wheel,) = Path(name).glob("*.whl")
        with ThreadPoolExecutor(2) as pool:
            for one, tried in [(one, pool.submit(_try, one, wheel)) for one in environments]:
                try:
                    print(f"{one.name}: {tried.result()}", flush=True)
                except (FailedError, RuntimeError, subprocess.TimeoutExpired) as error:
                    failed += 1
                    print(f"{one.name}: FAILED: {error}", flush=True)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent, computed = (time.monotonic() - started) / 60.0, (used.ru_utime + used.ru_stime) / 60.0
    result = f"{len(environments) - failed} good, {failed} bad"
    print(f"environments: {result} ({spent:.1f} min, {computed:.1f} min of CPU time)")
    return 1 if failed or not environments else 0


if __name__ == "__main__":
    sys.exit(main())

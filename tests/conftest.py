"""Fixtures of all tests: golden cases, reference trajectories, and measured data that a user may lack."""

import contextlib
import gc
import json
import os
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import hypothesis
import pytest
from _pytest.runner import runtestprotocol

from tests.patience import STILL_S, StandStill
from tests.ros_domain import free_domain

ROOT = Path(__file__).resolve().parent.parent

# No example fails for its time on a busy machine, and what fails once fails again; new examples are drawn
# with `--hypothesis-profile=default`.
hypothesis.settings.register_profile("repeatable", deadline=None, derandomize=True)
hypothesis.settings.load_profile("repeatable")


def pytest_addoption(parser: pytest.Parser) -> None:
    """What `pytest -m hil` runs on."""
    real = parser.getgroup("hil", "tests on real devices")
    real.addoption("--platform", help="platform file of real devices, or the name of a shipped one")
    real.addoption("--device", help="path or address in place of the platform's")
    real.addoption("--most-pa", type=float, default=20e3, help="highest set point of them [Pa gauge]")


@pytest.fixture(scope="session", autouse=True)
def worker_domain() -> Iterator[None]:
    """Nodes of a test that takes no ROS domain of its own meet those of no other worker."""
    with contextlib.ExitStack() as held, pytest.MonkeyPatch.context() as patch:
        try:
            number = held.enter_context(free_domain())
        except RuntimeError:  # most tests need none
            number = 0
        patch.setenv("ROS_DOMAIN_ID", str(number))
        yield


@pytest.fixture(scope="session")
def golden() -> list[dict[str, Any]]:
    """Robots at one state each, with the right dynamics; see tests/golden/README.md."""
    cases: list[dict[str, Any]] = json.loads((ROOT / "tests/golden/dynamics.json").read_text())["cases"]
    return cases


@pytest.fixture(scope="session")
def reference() -> Path:
    """Folder of converged trajectories; see its README.md."""
    return ROOT / "tests/reference"


@pytest.fixture(scope="session")
def data() -> Path:
    """Folder of measured data of real robots (SORO_DATA, or `data` in SORO_SHARED); else skip the test."""
    shared = Path(os.environ.get("SORO_SHARED", ROOT.parent / "shared"))
    folder = Path(os.environ.get("SORO_DATA", shared / "data"))
    if not folder.is_dir():
        pytest.skip(f"no measured data in {folder} (set SORO_DATA)")
    return folder


@pytest.fixture
def figure(request: pytest.FixtureRequest) -> Callable[[str], None]:
    """Note a measured figure: printed at the end of the test run, whether or not the test passed."""

    def note(text: str) -> None:
        request.node.user_properties.append(("figure", text))

    return note


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """Repeat a test of real time, twice at most, if it fails while the machine stands still.

    A deadline that is missed because the machine gives a program no time says nothing of the program. Where
    the machine has not stood still, or does so three times, the failure counts.
    """
    if item.get_closest_marker("real_time") is None:
        return None
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    for attempt in range(3):
        with StandStill() as stood:
            reports = runtestprotocol(item, nextitem=nextitem, log=False)
        if attempt == 2 or stood.longest_s < STILL_S or not any(report.failed for report in reports):
            break
        pytest_runtest_logfinish()
        item._initrequest()  # fixtures anew
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


def pytest_runtest_logfinish() -> None:
    """Collect what a failed test left open, which else fails a later test by its warning."""
    if getattr(sys, "last_value", None) is None:
        return
    sys.last_type = sys.last_value = sys.last_traceback = sys.last_exc = None  # hold the test's frames
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)
        gc.collect()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print what was measured."""
    lines = [
        text
        for reports in terminalreporter.stats.values()
        for report in reports
        if getattr(report, "when", "") == "call"
        for name, text in report.user_properties
        if name == "figure"
    ]
    if lines:
        terminalreporter.section("figures measured")
        for line in lines:
            terminalreporter.write_line(line)


# Whole runs of nodes: one worker takes them all, as only one at a time may use real time, and first what
# compiles their kernels.
_COMPILES = "tests/soro_core/loop/test_closed_loop.py::test_the_main_job"
_NODES = (_COMPILES, "tests/soro_core/twin/", "tests/soro_ros/")
# Devices answer in real time too: another worker takes them all.
_DEVICES = ("tests/soro_hardware/", "tests/benchmarks/test_bench_hardware.py")
# What of ROS keeps no time: any worker takes it, a file at a time, the long ones first, so that all end
# together.
_TIMELESS = tuple(
    f"tests/soro_ros/test_{name}.py"
    for name in (
        *("whole_way", "closed_loop", "excite", "new_command", "fault_injection", "probe", "scenes"),
        *("convert", "extreme_messages", "film", "foreign_bags", "plot", "replay", "report"),
    )
)
# One that has done these computes: first what needs no kernels, or only its own (finite elements), until
# those of the nodes are there, and what compiles the other variants of a step, which two would both compile.
_ORDER = (
    *_NODES,
    *_DEVICES,
    "tests/soro_lab/bag/",
    "tests/soro_core/safety/",
    "tests/soro_design/fem/",
    "tests/soro_design/topology/",
    "tests/soro_core/robot/",
    "tests/apparatus/",
    "tests/soro_core/integrate/",
    "tests/soro_core/model/",
    "",
    *_TIMELESS,
    "tests/benchmarks/",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Sort by the place of a test's folder or file in `_ORDER`; what has a domain of ROS needs ROS."""

    def rank(item: pytest.Item) -> int:
        return _ORDER.index(max((one for one in _ORDER if item.nodeid.startswith(one)), key=len))

    items.sort(key=rank)
    for item in items:
        if "domain" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.ros)


# `--dist loadgroup` does not do it: xdist 3.8 writes the group into `_nodeid`, which pytest 9.2 has not.
@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Give the nodes that keep time to one worker, the devices to one, and the rest to any, file by file.

    What the tests of a file share is then made once.
    """
    from xdist.scheduler import LoadScopeScheduling

    class Scheduling(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            if nodeid.startswith(_DEVICES):
                return "devices"
            in_real_time = nodeid.startswith(_NODES) and not nodeid.startswith(_TIMELESS)
            return "nodes" if in_real_time else nodeid.split("::")[0]

    config.option.loadscopereorder = False  # keeps `_ORDER`
    return Scheduling(config, log)


_NICE = pytest.StashKey[bool]()


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Lower the priority of what computes beside nodes and devices, which keep time by the clock."""
    keeps_time = item.nodeid.startswith((*_NODES, *_DEVICES))
    if "PYTEST_XDIST_WORKER" in os.environ and not keeps_time and _NICE not in item.config.stash:
        item.config.stash[_NICE] = True
        os.nice(5)

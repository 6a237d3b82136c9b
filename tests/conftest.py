"""Shared fixtures: reference data that a checkout may or may not have beside it."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parent.parent


def pytest_addoption(parser: pytest.Parser) -> None:
    """What `pytest -m hil` runs on."""
    real = parser.getgroup("hil", "tests on real devices")
    real.addoption("--platform", help="platform file of real devices, or the name of a shipped one")
    real.addoption("--device", help="path or address in place of the platform's")
    real.addoption("--most-pa", type=float, default=20e3, help="highest set point of them [Pa gauge]")


@pytest.fixture(scope="session")
def shared() -> Path:
    """Folder with golden results and measured data; the test is skipped where it is absent."""
    folder = Path(os.environ.get("SORO_SHARED", ROOT.parent / "shared"))
    if not (folder / "golden").is_dir():
        pytest.skip(f"reference data not found in {folder} (set SORO_SHARED)")
    return folder


@pytest.fixture(scope="session")
def data(shared: Path) -> Path:
    """Folder with measured data of real robots (SORO_DATA overrides)."""
    return Path(os.environ.get("SORO_DATA", shared / "data"))


@pytest.fixture
def figure(request: pytest.FixtureRequest) -> Callable[[str], None]:
    """Note a measured figure: printed at the end of the test run, whether or not the test passed."""

    def note(text: str) -> None:
        request.node.user_properties.append(("figure", text))

    return note


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


# Whole runs of nodes wait more than they compute, and only one at a time may use real time: one worker takes
# them all, first what compiles their kernels, while the others compute. Others that need them are last.
_COMPILES = "tests/loop/test_closed_loop.py::test_the_main_job"
_NODES = (_COMPILES, "tests/twin/", "tests/ros/")
# What takes longest to compile, the other variants of a step, meanwhile: two workers that came to it together
# would both compile it. Before it what needs no kernels, until those of the nodes are there.
_VARIANTS = ("tests/bag/", "tests/safety/", "tests/integrate/", "tests/model/")
_LAST = "tests/loop/"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the kernels' compilation before the runs of nodes."""

    def rank(item: pytest.Item) -> int:
        beginnings = (*_NODES, *_VARIANTS, "", _LAST)
        first = (n for n, one in enumerate(beginnings) if one and item.nodeid.startswith(one))
        return next(first, beginnings.index(""))

    items.sort(key=rank)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Give the runs of nodes to one worker, and the other tests one by one."""
    from xdist.scheduler import LoadScopeScheduling

    class Scheduling(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return "nodes" if nodeid.startswith(_NODES) else nodeid

    return Scheduling(config, log)

"""The emulated valves of a run: their process, and the links by which driver, twin and faults reach it."""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from soro_core.errors import SoroError
from soro_lab.scene import Scene
from soro_ros.run.processes import Child

# Emulated valves compile nothing.
VALVES_LIMIT_S = 20.0


class Links:
    """A folder of its own, until `close`; the path of a socket has at most 107 characters.

    Attributes
    ----------
    device : Path
        Serial line or bus of the driver.
    plant, faults : Path
        Sockets of the twin, and of faults.
    """

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="soro-")
        links = Path(self._folder.name)
        self.device, self.plant, self.faults = (
            links / name for name in ("valves.pty", "plant.sock", "faults.sock")
        )

    def close(self) -> None:
        """Remove the folder."""
        self._folder.cleanup()


def start_valves(scene: Scene, folder: Path, links: Links, start: Callable[..., Child]) -> Child:
    """Start the emulated valves of a scene.

    Parameters
    ----------
    scene : Scene
    folder : Path
        Of the run, for the log.
    links : Links
    start : callable
        `processes.start`, or that of a fork server.
    """
    command = [sys.executable, "-m", "soro_hardware.emulation", scene.platform]
    command += ["--device-link", str(links.device), "--plant-link", str(links.plant)]
    command += ["--control", str(links.faults)]
    command += ["--seed", str(scene.seed), "--cycle-hz", str(scene.rate_hz)]
    if scene.mode == "lockstep":
        command.append("--lockstep")
    # Above the priority of the driver: real devices have processors of their own.
    return start(f"{scene.prefix}valves", command, folder, 40 if scene.mode == "real_time" else 0)


def wait_for_valves(valves: Child, check: Callable[[], None]) -> None:
    """Wait until emulated valves are ready, or `check` raises what ends the wait.

    Raises
    ------
    SoroError
        If they are not ready in time.
    """
    deadline = time.monotonic() + VALVES_LIMIT_S
    while "ready:" not in valves.log.read_text(errors="replace"):
        check()
        if time.monotonic() > deadline:
            raise SoroError(f"emulated valves are not ready: {valves.last_lines()}")
        time.sleep(0.02)

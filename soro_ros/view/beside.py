"""The viewer beside a run: a process of its own, whose end never ends the run."""

from __future__ import annotations

import contextlib
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from soro_core.config import with_changes
from soro_core.errors import SoroError
from soro_lab.scene import Scene, with_robot_files
from soro_ros.run import processes
from soro_ros.view.config import ViewerConfig

_START_LIMIT_S = 60.0
_END_LIMIT_S = 5.0
_POLL_S = 0.05


@contextlib.contextmanager
def viewing(scene: Scene, folder: Path, interrupted: Sequence[int]) -> Iterator[str]:
    """Start the viewer of a scene, give its address with the token, and end it afterwards.

    Parameters
    ----------
    scene : Scene
        What is going to run.
    folder : Path
        Folder of the run.
    interrupted : sequence of int
        Signals that end the run.

    Raises
    ------
    SoroError
        If it does not start.
    """
    with tempfile.TemporaryDirectory(prefix="soro-view-") as private:  # of this user alone, unlike the log
        told = Path(private) / "address"
        configs = {
            f"{arm.prefix}viewer": ViewerConfig(
                robot=arm.robot,
                payload_kg=arm.twin.payload_kg if scene.arm == "simulated" else 0.0,
                address_file=str(told),
                mounted_on=arm.mounted_on,
            )
            for arm in with_robot_files(scene, folder).each
        }
        if scene.bodies:
            first = next(iter(configs))
            configs[first] = with_changes(configs[first], bodies_file=str(folder / "scene_used.yaml"))
        if scene.arms:
            command = processes.arms_command(configs, scene.name, folder)
        else:
            command = processes.node_command("viewer", configs["viewer"], scene.name, folder)
        child = processes.start("viewer", command, folder)
        try:
            yield _address(child, told, interrupted)
        finally:
            processes.stop(child, _END_LIMIT_S)


def _address(child: processes.Child, told: Path, interrupted: Sequence[int]) -> str:
    deadline = time.monotonic() + _START_LIMIT_S
    while not interrupted:
        if told.exists() and (address := told.read_text()):
            return address
        if child.process.poll() is not None:
            raise SoroError(child.end_report())
        if time.monotonic() > deadline:
            raise SoroError(f"the viewer is not ready after {_START_LIMIT_S:.0f} s: {child.last_lines()}")
        time.sleep(_POLL_S)
    return ""

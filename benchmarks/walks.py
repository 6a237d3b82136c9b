"""How many functions does one tick of each part call? ``python -m benchmarks.walks [--jobs] [--list]``.

A walk is the set of named functions of the project's packages that a thread enters in one tick, kernels
included (numba reports them to a profiler). A comprehension or a lambda belongs to the function that writes
it. The walks, all of the scene `track_circle` after half a second:

- `control tick`: `Controller.step`, from the state to the command. The longest of 40 ticks.
- `CANopen cycle`: `exchange` of the driver on the emulated bus in lockstep, from the set points to the
  readings of the answers, the devices included; what moves the emulated time on is not: in real time the
  process of the emulator does that between cycles. The shortest of 40: no heartbeat is due in it.
- `pose to state`: `Estimator.step` with one pose and what the law has learned. The longest of 40 ticks.
- `scene key to node`: `load_scene` with one changed key, up to the parameters of the controller process. The
  second of two: what is kept between scenes is known then.

Two walks of whole jobs, with ``--jobs``, some five minutes:

- `recording to robot file`: `soro identify` of a shipped bag of 2 s, without further laws, one start.
- `part to robot file`: `soro identify-fem` of the shipped rod, in a coarse mesh and with short sweeps.
"""

from __future__ import annotations

import contextlib
import io
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from types import CodeType, FrameType
from typing import Annotated, Any

import numpy as np
import typer
import yaml
from rich.console import Console

from benchmarks.report import table
from soro_core.loop import certainty_of
from soro_core.twin import Twin
from soro_design.commands.identify_fem import identify_fem
from soro_hardware import load_platform
from soro_hardware.canopen.config import CanopenPlatform
from soro_hardware.canopen.driver import CanopenRegulator
from soro_hardware.emulation.devices import EmulatedDevices
from soro_lab.commands.identify import identify
from soro_lab.scene import load_scene
from soro_lab.scene.loop import loop_of
from tests.soro_hardware.hub_bus import HubBus

ROOT = Path(__file__).parents[1]
PACKAGES = ("soro_core", "soro_hardware", "soro_lab", "soro_design", "soro_ros")
SCENE = "track_circle"
# Ticks before the first one that counts, and ticks that count: the rarest work of a tick comes each 0.1 s.
_BEFORE, _COUNTED = 100, 40


class Walk:
    """Named functions in the order in which a thread enters them first.

    Parameters
    ----------
    beside : code objects, optional
        Functions that do not count, with all that they call.
    """

    def __init__(self, *beside: CodeType) -> None:
        self._seen: dict[CodeType, None] = {}
        self._beside, self._depth = frozenset(beside), 0

    @contextlib.contextmanager
    def taken(self) -> Iterator[None]:
        """Follow this thread, and those that it starts."""
        threading.setprofile(self._note)
        sys.setprofile(self._note)
        try:
            yield
        finally:
            sys.setprofile(None)
            threading.setprofile(None)

    def _note(self, frame: FrameType, event: str, _: Any) -> None:
        code = frame.f_code
        if code in self._beside:
            self._depth += {"call": 1, "return": -1}.get(event, 0)
        elif event == "call" and not self._depth:
            self._seen.setdefault(code)

    @property
    def functions(self) -> list[tuple[str, str]]:
        """File, relative to the project, and qualified name of each function of the project."""
        found = [
            (Path(code.co_filename), code.co_qualname)
            for code in self._seen
            if not code.co_name.startswith("<")
        ]
        return [
            (str(file.relative_to(ROOT)), name)
            for file, name in found
            if file.is_relative_to(ROOT) and file.relative_to(ROOT).parts[0] in PACKAGES
        ]

    def __len__(self) -> int:
        return len(self.functions)

    @property
    def files(self) -> int:
        """Number of files that these functions stand in."""
        return len({file for file, _ in self.functions})


def loop_walks() -> tuple[Walk, Walk]:
    """Return the walks of a control tick and from a pose to the state."""
    scene = load_scene(SCENE)
    loop, twin, dt = loop_of(scene), Twin(scene.loaded_robot, scene.twin_node()), 1.0 / scene.rate_hz
    plant, state = twin.initial(), loop.initial_state(-dt)
    estimator, controller, learned = state.estimator, state.controller, state.learned
    under_way = deque([np.zeros(loop.controller.arm.n_u)])
    estimates, controls = [], []
    for k in range(_BEFORE + _COUNTED):
        if k > 0:
            plant = twin.step_setpoints(plant, under_way.popleft())
        plant, seen = twin.observe(plant)
        estimate_walk, control_walk = Walk(), Walk()
        with estimate_walk.taken():
            estimator, estimate = loop.estimator.step(
                estimator, seen.reading_pa, seen.poses, seen.imus, dt, learned
            )
        certainty = certainty_of(estimate)
        with control_walk.taken():
            controller, command = loop.controller.step(
                controller, estimate.q, estimate.qd, estimator.t_s, dt, seen.reading_pa, None, certainty
            )
        learned = command.learned
        under_way.append(command.setpoint_pa)
        if k >= _BEFORE:
            controls.append(control_walk)
            estimates += [estimate_walk] if len(seen.poses) == 1 else []
    return max(controls, key=len), max(estimates, key=len)


def canopen_walk() -> Walk:
    """Return the walk of a cycle of the CANopen driver, with the part of the emulated devices."""
    platform = load_platform(load_scene(SCENE).platform)
    assert isinstance(platform, CanopenPlatform)
    period_ns, walks = round(1e9 / platform.cycle_hz), []
    regulator = CanopenRegulator(platform, lambda: HubBus(platform), time.monotonic, lockstep=True)
    with contextlib.closing(regulator):
        regulator.configure()
        for k in range(_BEFORE + _COUNTED):
            setpoint_pa = 20e3 + 10e3 * np.sin(0.05 * k + np.arange(regulator.n_chambers))
            walk = Walk(EmulatedDevices.end_cycle.__code__)
            with walk.taken():
                regulator.exchange(setpoint_pa, (k + 1) * period_ns)
            walks += [walk] if k >= _BEFORE else []
    return min(walks, key=len)


def scene_walk() -> Walk:
    """Return the walk of a key of a scene from its file to the parameters of a node."""
    for _ in range(2):
        walk = Walk()
        with walk.taken():
            load_scene(SCENE, {"controller.adapt": False}).controller_node()
    return walk


def recording_walk(folder: Path) -> Walk:
    """Return the walk of `soro identify`, which writes into a folder."""
    walk = Walk()
    with walk.taken(), contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(typer.Exit):
        identify(
            "tue_three_bellow",
            folder / "arm.yaml",
            [ROOT / "bags" / "track_circle_lockstep_2s"],
            laws="none",
            starts=1,
            constant=True,
        )
    return walk


def part_walk(folder: Path) -> Walk:
    """Return the walk of `soro identify-fem`, which writes into a folder."""
    part = yaml.safe_load((ROOT / "config" / "parts" / "silicone_rod_three_chambers.yaml").read_text())
    part["geometry"] |= {"around": 2, "across": 1, "along": 6}
    part["sweeps"] = [
        {"name": "pull", "force_n": [0.0, 0.0, 3.0], "states": 2},
        {"name": "side", "force_n": [0.02, 0.0, 0.0], "states": 1},
        {"name": "all", "pressures_pa": [15e3, 15e3, 15e3], "states": 2},
        {"name": "one", "pressures_pa": [12e3, 0.0, 0.0], "states": 2},
        {"name": "mixed", "pressures_pa": [6e3, 10e3, 0.0], "states": 1, "held_out": True},
    ]
    file = folder / "rod.yaml"
    file.write_text(yaml.safe_dump(part), encoding="utf-8")
    walk = Walk()
    with walk.taken(), contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(typer.Exit):
        identify_fem(str(file), folder / "rod_arm.yaml")
    return walk


def jobs() -> dict[str, Walk]:
    """Return the walks of whole jobs by name."""
    with tempfile.TemporaryDirectory() as folder:
        return {
            "recording to robot file": recording_walk(Path(folder)),
            "part to robot file": part_walk(Path(folder)),
        }


def walks() -> dict[str, Walk]:
    """Return the walks of a tick by name."""
    control, pose = loop_walks()
    return {
        "control tick": control,
        "CANopen cycle": canopen_walk(),
        "pose to state": pose,
        "scene key to node": scene_walk(),
    }


def main(
    listed: Annotated[bool, typer.Option("--list", help="name the functions too, in their order")] = False,
    whole: Annotated[bool, typer.Option("--jobs", help="two whole jobs too, five minutes")] = False,
) -> None:
    """Count the functions that one tick of each part calls, and the files that they stand in."""
    console, found = Console(), walks() | (jobs() if whole else {})
    rows: list[list[object]] = [[name, len(walk), walk.files] for name, walk in found.items()]
    console.print(table(["walk", "functions", "files"], rows), markup=False, soft_wrap=True)
    for name, walk in found.items() if listed else ():
        lines = [f"{file} {function}" for file, function in walk.functions]
        console.print("\n".join(["", f"{name}:", *lines]), markup=False, highlight=False, soft_wrap=True)


if __name__ == "__main__":
    typer.run(main)

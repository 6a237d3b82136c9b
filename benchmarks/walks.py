"""How many functions does one tick of each part call? ``python -m benchmarks.walks [--list]``.

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
"""

from __future__ import annotations

import contextlib
import sys
import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from types import CodeType, FrameType
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console

from benchmarks.report import table
from soro_core.loop import certainty_of
from soro_core.twin import Twin
from soro_hardware import load_platform
from soro_hardware.canopen.config import CanopenPlatform
from soro_hardware.canopen.driver import CanopenRegulator
from soro_hardware.emulation.devices import EmulatedDevices
from soro_hardware.testing.hub_bus import HubBus
from soro_lab.scene import load_scene
from soro_lab.scene.loop import loop_of

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
        """Follow this thread."""
        sys.setprofile(self._note)
        try:
            yield
        finally:
            sys.setprofile(None)

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


def walks() -> dict[str, Walk]:
    """Return all walks by name."""
    control, pose = loop_walks()
    return {
        "control tick": control,
        "CANopen cycle": canopen_walk(),
        "pose to state": pose,
        "scene key to node": scene_walk(),
    }


def main(
    listed: Annotated[bool, typer.Option("--list", help="name the functions too, in their order")] = False,
) -> None:
    """Count the functions that one tick of each part calls, and the files that they stand in."""
    console, found = Console(), walks()
    rows: list[list[object]] = [[name, len(walk), walk.files] for name, walk in found.items()]
    console.print(table(["walk", "functions", "files"], rows), markup=False, soft_wrap=True)
    for name, walk in found.items() if listed else ():
        lines = [f"{file} {function}" for file, function in walk.functions]
        console.print("\n".join(["", f"{name}:", *lines]), markup=False, highlight=False, soft_wrap=True)


if __name__ == "__main__":
    typer.run(main)

"""Each process of a running arm is killed in turn and started again, while the others go on."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.patience import COMPILED_S, LIMIT_S, patient_platform
from tests.soro_ros.arm_watch import ArmWatch
from tests.soro_ros.running import SORO, wait_until
from tests.warm import Popen

pytestmark = pytest.mark.process

# Of the driver, whose sentence says what the death cost; the note of a killed one names its process.
SAYS = {
    "estimator": "command lost",
    "controller": "command lost",
    "twin": "command lost",
    "regulator": "ended without venting",
    "valves": "the adapter is gone",
}


class Suite(ArmWatch):
    """Emulated valves, twin, estimator, controller, regulator and recorder: a process each.

    Nothing but a death may end the control, however busy the machine is: 50 Hz, and generous ages.

    Parameters
    ----------
    folder : Path
        For links, bags and the platform file.
    """

    def __init__(self, folder: Path) -> None:
        device, plant, bags = folder / "valves.pty", folder / "plant.sock", folder / "bag"
        platform = patient_platform(folder)
        loop = {"rate_hz": 50.0}
        ages = {"limits.command_age_s": 0.5, "limits.reading_age_s": 0.5}
        reference = {"control.reference.kind": "circle", "control.reference.start_s": 0.5}
        reference["control.probe_at_enable"] = "'off'"  # it takes seconds at each enable
        self._settings = {
            "twin": {**loop, "pressures": "valves", "plant_link": plant, "pose.rate_hz": 50.0, "refine": 1},
            "estimator": {**loop, "filter.lost_after_s": 1.0, "backbone_rate_hz": 0.0},
            "controller": {**loop, "platform": platform, "state_age_s": 1.0, **reference},
            "regulator": {**loop, "platform": platform, "device": device, **ages},
            "recorder": {"folder": bags},
        }
        self._valves = [platform, "--device-link", device, "--plant-link", plant, "--rate", "50Hz"]
        self._folder, self._bags = folder, 0
        super().__init__("suite", "regulator")
        self.processes: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, *names: str) -> None:
        """Start processes, and wait until those that are nodes are active."""
        for name in names:
            if name == "recorder":  # it never continues a bag
                self._bags += 1
                self._settings[name]["folder"] = self._folder / f"bag{self._bags}"
            command = [str(part) for part in self._command(name)]
            with self._log(name).open("wb") as log:
                self.processes[name] = Popen(command, stdout=log, stderr=log)
            if name == "valves":  # the twin joins them
                wait_until(lambda: "ready:" in self._log("valves").read_text(), "emulated valves")
        for name in set(names) - {"valves"}:
            self.until(lambda name=name: self._runs(name), f"{name} active", COMPILED_S)

    def _log(self, name: str) -> Path:
        return self._folder / f"{name}.log"

    def _command(self, name: str) -> list[object]:
        if name == "valves":
            return [*SORO, "emulate", *self._valves]
        given = [part for key, value in self._settings[name].items() for part in ("-p", f"{key}:={value}")]
        module = f"soro_ros.nodes.{name}"
        return [sys.executable, "-m", module, "--ros-args", "-r", "__ns:=/suite", *given]

    def _runs(self, name: str) -> bool:
        """Whether this very process reports that it is active."""
        process = self.processes[name]
        assert process.poll() is None, self._log(name).read_text()
        pid = self.supervisor.values(name).get("pid")
        return self.supervisor.active(name) and pid == str(process.pid)

    def kill(self, name: str) -> None:
        """SIGKILL."""
        self.processes[name].kill()
        self.processes[name].wait()

    def close(self) -> None:
        """End everything, first the driver."""
        for name in ("regulator", "controller", "estimator", "twin", "recorder", "valves"):
            if name in self.processes:
                self.processes[name].terminate()
                self.processes[name].wait(LIMIT_S)
        super().close()


@pytest.fixture
def suite(domain, tmp_path) -> Iterator[Suite]:
    suite = Suite(tmp_path)
    try:
        suite.start("valves")
        suite.start("recorder", "twin", "estimator", "controller")
        suite.start("regulator")
        yield suite
    finally:
        suite.close()


@pytest.mark.real_time
def test_what_cost_commands_or_readings_vents_until_a_reset_and_the_rest_goes_on_by_itself(suite):
    suite.call("controller/enable")
    suite.until(suite.under_control, "control")
    suite.kill("recorder")  # costs neither
    suite.start("recorder")
    assert suite.under_control(), suite.latched()
    for name, says in SAYS.items():
        suite.kill(name)
        if name == "regulator":  # the valves vent by themselves, and the next driver finds its note
            suite.start(name)
        suite.until(suite.latched, f"a latch after the death of {name}")
        assert says in suite.latched(), name
        if name == "valves":  # their end is that of their twin, too
            assert suite.processes["twin"].wait(LIMIT_S) == 1
            suite.start("valves", "twin")
        elif name != "regulator":
            suite.start(name)
        if name != "valves":  # their readings come after the reset only
            suite.until(suite.empty, "an empty arm")
        assert suite.latched(), name  # a process that is back opens no latch
        suite.recover()
        suite.until(suite.under_control, f"control after the death of {name}")

"""A regulator node on emulated valves, and a person who commands it, in lockstep or in real time."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from soro_core.errors import HardwareError
from soro_hardware.emulation.sockets.plant_link import PlantLinkClient
from soro_ros.conversion import messages, qos
from soro_ros.host import services
from soro_ros.run.supervisor import RunMonitor
from soro_ros.topics.diagnostics import ERROR
from tests.patience import LIMIT_S, patient_platform
from tests.soro_ros.running import end, wait_until
from tests.warm import Popen

NAMES = ("link0/chamber0", "link0/chamber1", "link0/chamber2")
PERIOD_S = 5e-3


class Bench:
    """Emulated valves, a regulator node, and a person who publishes commands.

    In lockstep nothing depends on how fast or busy the machine is: the person sets the time, by one cycle of
    5 ms after another. In real time a cycle passes by itself, and the person commands at 100 Hz.

    Parameters
    ----------
    folder : Path
        For the platform file and sockets.
    lockstep : bool
        Which of the two.
    """

    def __init__(self, folder: Path, lockstep: bool) -> None:
        self.lockstep, self.t_s = lockstep, 10.0
        self.processes: list[subprocess.Popen[str]] = []
        try:
            self._open(folder)
        except BaseException:
            self.end_processes()
            rclpy.try_shutdown()
            raise

    def _open(self, folder: Path) -> None:
        platform = patient_platform(folder, real_time=not self.lockstep)
        device, self._link_path = folder / "valves.pty", folder / "plant.sock"
        self._emulate = [sys.executable, "-m", "soro_hardware.emulation", platform]
        self._emulate += ["--device-link", device, "--plant-link", self._link_path]
        settings = {"device": device, "platform": platform}
        if self.lockstep:
            self._emulate.append("--lockstep")
            settings |= {"mode": "lockstep", "lockstep_timeout_s": 600.0}
        else:  # what is tested is not how punctual the person is
            settings |= {"limits.command_age_s": 0.5, "limits.reading_age_s": 0.5}
        self.start_valves()
        self.supervisor = RunMonitor("bench")
        node = [sys.executable, "-m", "soro_ros.nodes.regulator", "--ros-args", "-r", "__ns:=/bench"]
        self._regulate = [
            *node,
            *(part for key, value in settings.items() for part in ("-p", f"{key}:={value}")),
        ]
        self.regulator = self._start(self._regulate)
        self.node = Node("person", namespace="bench")
        self.command = self.node.create_publisher(JointState, "chambers/command", qos.loop(self.lockstep))
        self.array = self.node.create_publisher(Float64MultiArray, "chambers/commands", qos.RELIABLE)
        self.clock = self.node.create_publisher(Clock, "/clock", qos.LOCKSTEP)
        self._reading_ns = 0
        self.node.create_subscription(JointState, "chambers/state", self._on_reading, qos.loop(self.lockstep))
        self.supervisor.add_node(self.node)
        self.until(lambda: self.supervisor.active("regulator"), "the regulator")
        self.until(lambda: self.command.get_subscription_count() >= 1, "discovery")
        self.until(lambda: self.array.get_subscription_count() >= 1, "discovery")

    def _on_reading(self, message: JointState) -> None:
        self._reading_ns = messages.to_ns(message.header.stamp)

    def until(self, condition: Callable[[], object], what: str) -> None:
        """Take in what comes until something is true; no time passes in lockstep."""
        wait_until(lambda: self.supervisor.spin(0.02) or condition(), what, every_s=0.0)

    def start_regulator(self) -> None:
        """Start the node anew, in place of one that has ended."""
        before = self._subscriptions()  # one that was killed stays known for a while
        self.regulator = self._start(self._regulate)
        pid = str(self.regulator.pid)  # what is heard may still be of the one before
        self.until(lambda: self.supervisor.values("regulator").get("pid") == pid, "its process")
        self.until(lambda: self.supervisor.active("regulator"), "the regulator")
        self.until(lambda: self._subscriptions() - before, "discovery")

    def _subscriptions(self) -> set[bytes]:
        found = self.node.get_subscriptions_info_by_topic("/bench/chambers/command")
        return {bytes(one.endpoint_gid) for one in found}

    def change(self, transition: int, state: str) -> None:
        """Bring the node to a state of its lifecycle while 30 kPa are commanded all the time."""
        request = ChangeState.Request(transition=Transition(id=transition))
        call = services.Call(self.node, ChangeState, "regulator/change_state", request)

        def changed() -> bool:
            self.send([30e3] * 3, 0.02)
            call.done()
            return self.supervisor.values("regulator")["lifecycle"] == state

        wait_until(changed, state, every_s=0.0)
        call.close()

    def _start(self, command: list[object]) -> subprocess.Popen[str]:
        arguments = [str(part) for part in command]
        process = Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.processes.append(process)
        return process

    def start_valves(self) -> None:
        """Start the emulated valves, and read their true pressures."""
        self.valves = self._start(self._emulate)
        wait_until(self._connected, "emulated valves")

    def _connected(self) -> bool:
        try:
            self.link = PlantLinkClient(self._link_path)
        except HardwareError:
            return False
        return True

    def send(self, pressure_pa: list[float], seconds: float, age_s: float = 0.0, name: str = "") -> None:
        """Publish one command over and over, under a name."""
        for _ in self._passing(seconds):
            self.publish(pressure_pa, age_s, name)

    def publish(self, pressure_pa: list[float], age_s: float = 0.0, name: str = "") -> None:
        """Publish a command that was made so long ago."""
        now_ns = round(1e9 * self.t_s) if self.lockstep else self.node.get_clock().now().nanoseconds
        command = np.array(pressure_pa, dtype=float)
        message = messages.chambers(NAMES, command, now_ns - round(age_s * 1e9))
        message.header.frame_id = name
        self.command.publish(message)

    def pause(self, seconds: float) -> None:
        """Let time pass without a command."""
        for _ in self._passing(seconds):
            pass

    def _passing(self, seconds: float) -> Iterator[None]:
        """Let time pass, after whatever is done in each cycle."""
        if self.lockstep:
            for _ in range(round(seconds / PERIOD_S)):
                yield
                self._cycle()
            return
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            yield
            self.supervisor.spin(0.01)

    def _cycle(self) -> None:
        """Let one cycle pass, after an empty command, as a controller gives it that has no other."""
        self.command.publish(messages.chambers((), np.zeros(0), round(1e9 * self.t_s)))
        self.t_s += PERIOD_S
        now_ns = round(1e9 * self.t_s)
        self.clock.publish(Clock(clock=messages.to_time(now_ns)))
        wait_until(
            lambda: self.supervisor.spin_once(LIMIT_S) or self._reading_ns == now_ns, "a reading", every_s=0.0
        )

    def true_pressure(self) -> np.ndarray:
        """Pressures [Pa gauge] in the emulated valves now."""
        if not self.lockstep:
            self.link.latest()  # old messages that were not read
            time.sleep(0.01)
        return self.link.latest().pressures

    def wait_empty(self) -> None:
        """Wait until the chambers are vented: in lockstep within 1 s of its time."""
        for _ in range(200 if self.lockstep else round(LIMIT_S / 0.02)):
            if self.true_pressure().max() < 2e3:
                return
            self.pause(PERIOD_S if self.lockstep else 0.02)
        raise AssertionError(f"not vented: {self.true_pressure()}")

    def fault(self) -> str:
        """What has latched the regulator, once it reports an error."""
        self.until(self.failed, "a fault")
        return self.supervisor.values("regulator")["cause"]

    def failed(self) -> bool:
        """Whether the regulator reports an error."""
        status = self.supervisor.status.get("regulator")
        return status is not None and status.level == ERROR

    def rejected(self, kind: str) -> int:
        """Commands of a kind that the regulator says it refused; diagnostics come once a second."""
        return int(self.supervisor.values("regulator").get(f"rejected {kind}", 0))

    def wait_rejected(self, kind: str, least: int) -> None:
        self.until(lambda: self.rejected(kind) >= least, f"{least} refusals: {kind}")

    def reset(self) -> None:
        """Open the latch, with a command of zero."""
        self.send([0.0] * 3, 0.3)
        self.supervisor.call("regulator/reset", LIMIT_S)

    def close(self) -> list[int]:
        """End everything; exit statuses of the processes."""
        # First what keeps the publishers alive, whose ticks the next in this domain would hear.
        self.supervisor.__exit__()
        self.node.destroy_node()
        self.link.close()
        return [process.returncode for process in self.end_processes()]

    def end_processes(self) -> list[subprocess.Popen[str]]:
        """End the regulator first, then its valves."""
        for process in reversed(self.processes):
            if not process.stdout.closed:
                end(process)
        return self.processes

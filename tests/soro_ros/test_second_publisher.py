"""Two programs that command one arm: named at once, and neither followed where both give one name."""

from __future__ import annotations

import subprocess
import sys
from functools import partial

import numpy as np
import pytest
import rclpy
from rclpy.duration import Duration
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from soro_core.safety import Limiter, Limits
from soro_ros.conversion import messages, qos
from soro_ros.host import middleware
from soro_ros.topics.chambers import ChamberInterface
from tests.patience import LIMIT_S
from tests.soro_ros.bench import NAMES, Bench
from tests.soro_ros.running import end, wait_until

CYCLE_NS = 5_000_000
LIMITS = Limits(rise_pa_s=20e3)


class Holder:
    """Whoever holds the air, without devices: a limiter behind the topics, readings that are its set points.

    A cycle is 5 ms of a clock of its own, and begins when the last message that was sent has come.
    """

    def __init__(self, **options) -> None:
        self.node, self.now_ns, self.taken = Node("holder"), 10**9, 0
        self.limiter = Limiter(LIMITS, NAMES)
        self.chambers = ChamberInterface(
            self.node, self.limiter, lambda: self.now_ns, lambda: self.now_ns, self._count, **options
        )
        self.executor = EventsExecutor()
        self.executor.add_node(self.node)

    def _count(self) -> None:
        self.taken += 1

    def spun(self) -> bool:
        self.executor.spin_once(timeout_sec=0.01)
        return True

    def heard(self, taken: int) -> bool:
        return self.spun() and self.taken > taken

    def cycle(self) -> None:
        self.limiter.judge(self.limiter.slew(self.now_ns), True, self.now_ns)
        self.now_ns += CYCLE_NS

    @property
    def rejected(self) -> dict[str, int]:
        return self.limiter.state.rejected

    @property
    def highest_pa(self) -> float:
        return float(self.limiter.state.setpoint_pa.max())


class Program:
    """A node that publishes commands under a name."""

    def __init__(
        self, holder: Holder, node: str, name: str, pressure_pa: float, lockstep: bool = False
    ) -> None:
        self._holder, self.name, self._pressure_pa = holder, name, pressure_pa
        self._qos = qos.loop(lockstep)
        self.node = Node(node)
        self.start()

    def start(self) -> None:
        self.publisher = self.node.create_publisher(JointState, "chambers/command", self._qos)
        wait_until(lambda: self.publisher.get_subscription_count() == 1, "discovery")

    def stop(self) -> None:
        self.node.destroy_publisher(self.publisher)

    def send(self, cycles: int = 1) -> None:
        """Publish once a cycle, and wait until it is taken."""
        for _ in range(cycles):
            command, holder = np.full(3, self._pressure_pa), self._holder
            message = messages.chambers(NAMES, command, holder.now_ns)
            message.header.frame_id = self.name
            taken = holder.taken
            self.publisher.publish(message)
            wait_until(partial(holder.heard, taken), "the message", every_s=0.0)
            holder.cycle()


@pytest.fixture
def joined(domain):
    middleware.init()
    yield
    rclpy.shutdown()


def both(live: Program, other: Program, cycles: int = 20) -> None:
    """Let two programs command in turn."""
    for _ in range(cycles):
        live.send()
        other.send()


def test_a_silent_second_publisher_is_named_and_the_live_one_goes_on(joined):
    holder = Holder()
    live = Program(holder, "person", "person", 30e3)
    live.send(10)
    assert holder.chambers.second_publisher is None
    silent = Program(holder, "silent", "", 0.0)
    wait_until(lambda: live.send() or holder.chambers.second_publisher, "the second publisher", every_s=0.0)
    assert holder.chambers.second_publisher == "2 publishers of chambers/command: /person, /silent"
    live.send(30)
    assert holder.limiter.cause is None
    assert not holder.rejected
    silent.stop()
    wait_until(lambda: holder.spun() and holder.chambers.second_publisher is None, "its end")


def test_a_second_publisher_of_another_name_is_refused_alone(joined):
    holder = Holder()
    live, rogue = Program(holder, "person", "person", 30e3), Program(holder, "rogue", "rogue", 80e3)
    live.send()
    both(live, rogue)
    assert holder.limiter.cause is None
    assert holder.rejected == {"second source": 20}
    assert np.all(holder.limiter.state.command_pa == 30e3)
    assert holder.chambers.second_publisher == "2 publishers of chambers/command: /person, /rogue"


@pytest.mark.parametrize("name", ["person", ""])
@pytest.mark.parametrize("lockstep", [False, True])
def test_of_two_publishers_that_give_one_name_none_is_followed(joined, name, lockstep):
    holder = Holder(lockstep=lockstep)
    live = Program(holder, "person", name, 30e3, lockstep)
    live.send(10)
    reached = holder.highest_pa
    assert 0.0 < reached < 30e3
    copy = Program(holder, "copy", f"{name} ", 80e3, lockstep)  # a space makes no other name
    copy.send()
    both(live, copy, 8)
    assert holder.limiter.cause is None
    assert holder.highest_pa == reached
    assert holder.rejected == {"same name": 17}
    both(live, copy, 3)
    assert holder.limiter.cause.startswith("command lost")
    assert holder.chambers.second_publisher == "2 publishers of chambers/command: /person, /copy"


@pytest.mark.slow
@pytest.mark.parametrize(("ahead", "followed"), [(10, 1), (300, 0)])
def test_a_copy_whose_numbers_are_ahead_is_followed_for_a_message_at_most(joined, ahead, followed):
    holder = Holder()
    copy = Program(holder, "copy", "copy", 80e3)
    for _ in range(ahead):
        copy.publisher.publish(JointState())
    assert copy.publisher.wait_for_all_acked(Duration(seconds=LIMIT_S))
    for _ in range(ahead + 1):
        holder.spun()
    live = Program(holder, "person", "person", 10e3)
    live.send(3)
    reached = holder.highest_pa
    copy.name = "person"
    both(live, copy, 3)
    assert holder.highest_pa == pytest.approx(reached + (1 + followed) * LIMITS.rise_pa_s * CYCLE_NS * 1e-9)
    both(live, copy)
    assert holder.highest_pa == 0.0
    assert holder.limiter.cause.startswith("command lost")


def test_the_configuration_can_follow_two_publishers_of_one_name(joined):
    holder = Holder(follow_shared_name=True)
    live, copy = Program(holder, "person", "one", 80e3), Program(holder, "copy", "one", 80e3)
    both(live, copy)
    assert holder.limiter.cause is None
    assert not holder.rejected
    assert np.all(holder.limiter.state.command_pa == 80e3)
    assert holder.chambers.second_publisher is not None


def test_two_publishers_of_commands_without_a_name_are_not_followed(joined):
    holder = Holder()
    nodes = [Node("one"), Node("two")]
    publishers = [
        node.create_publisher(Float64MultiArray, "chambers/commands", qos.RELIABLE) for node in nodes
    ]
    for publisher in publishers:
        wait_until(lambda p=publisher: p.get_subscription_count() == 1, "discovery")
    for _ in range(20):
        for publisher in publishers:
            refused = holder.rejected.get("same name", 0)
            publisher.publish(Float64MultiArray(data=[30e3] * 3))
            wait_until(lambda n=refused: holder.spun() and _arrived(holder, n), "the message", every_s=0.0)
            holder.cycle()
    assert holder.limiter.cause.startswith("command lost")
    assert holder.rejected["same name"] >= 38
    assert holder.chambers.second_publisher.startswith("2 publishers of chambers/commands: ")


def _arrived(holder: Holder, refused: int) -> bool:
    state = holder.limiter.state
    return state.rejected.get("same name", 0) > refused or state.command_stamp_ns >= holder.now_ns - CYCLE_NS


def test_a_program_that_starts_again_is_not_a_second_one(joined):
    """Its numbers begin anew, beside a publisher that stays and says nothing."""
    holder = Holder()
    live = Program(holder, "person", "person", 30e3)
    silent = Program(holder, "silent", "", 0.0)
    for _ in range(3):
        live.send(10)
        live.stop()
        live.start()
    assert holder.limiter.cause is None
    assert not holder.rejected
    silent.stop()


_KILLED = """
import sys
from rclpy.node import Node
from sensor_msgs.msg import JointState
import rclpy
rclpy.init()
node = Node("person")
publisher = node.create_publisher(JointState, "chambers/command", 10)
while True:
    publisher.publish(JointState(name=["of no chamber"]))
    rclpy.spin_once(node, timeout_sec=0.02)
"""
_LEASE_S, DEFAULT_LEASE_S = 2, 20
_SHORT_LEASE = f"""\
<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <participant profile_name="short" is_default_profile="true"><rtps><builtin><discovery_config>
    <leaseDuration><sec>{_LEASE_S}</sec></leaseDuration>
    <leaseAnnouncement><sec>0</sec><nanosec>300000000</nanosec></leaseAnnouncement>
  </discovery_config></builtin></rtps></participant>
</profiles>
"""


@pytest.mark.process
def test_a_program_that_was_killed_is_not_a_second_one_beyond_its_lease(joined, tmp_path, monkeypatch):
    """Started again it gives the same name, and the middleware keeps what was killed for a while."""
    holder = Holder()
    profiles = tmp_path / "lease.xml"
    profiles.write_text(_SHORT_LEASE)
    monkeypatch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", str(profiles))
    killed = subprocess.Popen([sys.executable, "-c", _KILLED])
    try:
        wait_until(lambda: holder.spun() and holder.taken > 0, "its messages", every_s=0.0)
    finally:
        killed.kill()
        killed.wait()
    again = Program(holder, "person", "", 30e3)
    again.send()
    assert holder.rejected["same name"] == 1  # it is there twice as far as anybody can say

    def followed() -> bool:
        again.send()
        return np.any(holder.limiter.state.command_pa)

    wait_until(followed, "the end of the lease", limit_s=DEFAULT_LEASE_S / 2, every_s=0.0)
    assert holder.chambers.second_publisher is None


_COPY = """
from rclpy.node import Node
from sensor_msgs.msg import JointState
import rclpy, time
rclpy.init()
node, heard = Node("copy", namespace="elsewhere"), []
node.create_subscription(JointState, "/bench/chambers/command", heard.append, 10)
publisher = node.create_publisher(JointState, "/bench/chambers/command", 10)
while rclpy.ok():
    rclpy.spin_once(node, timeout_sec=0.01)
    time.sleep(0.01)
    if heard:
        message = heard[-1]
        message.header.stamp = node.get_clock().now().to_msg()
        message.effort = [80e3] * len(message.name)
        publisher.publish(message)
"""


@pytest.mark.process
@pytest.mark.real_time
def test_a_program_that_copies_the_name_gives_the_arm_no_pressure(alone, domain, tmp_path):
    bench = Bench(tmp_path, lockstep=False)
    bench.send([30e3] * 3, 0.5)
    copy = subprocess.Popen([sys.executable, "-c", _COPY], stdout=subprocess.PIPE, text=True)
    both = ("/bench/person", "/elsewhere/copy")

    def named() -> bool:
        return all(name in bench.supervisor.status["regulator"].message for name in both)

    def tripped() -> bool:
        bench.send([30e3] * 3, 0.05)
        assert bench.true_pressure().max() < 35e3
        return bench.failed()

    try:
        wait_until(tripped, "a trip")
        assert bench.fault().startswith("command lost")
        bench.until(named, "both names")
        bench.wait_empty()
        bench.wait_rejected("same name", 10)
    finally:
        end(copy)
    bench.until(lambda: not named(), "the end of the copy")
    bench.reset()
    bench.send([30e3] * 3, 0.8)
    assert bench.true_pressure() == pytest.approx([30e3] * 3, abs=1.5e3)
    assert set(bench.close()) <= {0}

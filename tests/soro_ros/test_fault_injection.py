"""Faults from a scene and from the topic ~/fault reach the emulated valves, and the arm vents."""

import re
import selectors
import threading
import time

import pytest
import rclpy
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from std_msgs.msg import String
from std_srvs.srv import Trigger

from soro_core.errors import HardwareError
from soro_hardware.emulation.faults.schedule import FaultSchedule
from soro_hardware.emulation.sockets.control import ControlServer
from soro_lab.scene import load_scene
from soro_ros.conversion import qos
from soro_ros.host import middleware
from soro_ros.run import compose
from soro_ros.run.faults import FaultInterface
from tests.patience import patient_platform
from tests.soro_ros.running import run, summary, wait_until


@pytest.mark.process
@pytest.mark.parametrize(
    ("scene", "changes"),
    [
        ("valve_fails", ()),
        (
            "track_circle",
            (
                "twin={air: states, valve: {fill_m3_s_pa: 5.0e-11}}",
                "faults=[{at: 1.0, fault: stuck_open, chamber: link0/chamber1}]",
            ),
        ),
    ],
    ids=["of the valves", "of the twin"],
)
def test_a_fault_of_a_scene_vents_the_arm_and_ends_the_run_with_its_cause(domain, tmp_path, scene, changes):
    """A shipped scene on the air of the valves; and that of the twin, which is told of the fault."""
    platform = patient_platform(tmp_path, real_time=False)
    changes = ("mode=lockstep", f"platform={platform}", *changes)
    status, output, folder = run(tmp_path / "runs", *changes, scene=scene)
    assert status == 1, output
    found = summary(folder)
    assert found["verdict"] == "vented"
    cause = re.search(r"over-pressure: link0/chamber1 at ([\d.]+) kPa", found["reason"])
    assert cause, found["reason"]
    assert float(cause[1]) > 90.0  # the range of the robot
    assert found["pressure_max_pa"] > 90e3


@pytest.mark.parametrize(
    ("change", "key", "names"),
    [
        ("faults=[{fault: burst, chamber: link7/chamber1}]", "faults[0].chamber", ("link7/chamber1",)),
        ("faults=[{fault: jam}]", "faults[0]", ("drop",)),
    ],
)
def test_a_wrong_fault_of_a_scene_is_one_line(soro, tmp_path, change, key, names):
    ended = soro("run", "track_circle", "--set", change, "--folder", str(tmp_path / "runs"))
    assert ended.status == 2
    (line,) = ended.err.splitlines()
    assert key in line
    assert all(name in line for name in names), line


class Served:
    """A control socket with a thread behind it."""

    def __init__(self, path):
        self.faults = FaultSchedule()
        self.faults.chambers = ("link0/chamber0",)
        self._selector = selectors.SelectSelector()
        self._server = ControlServer(path, self.faults, self._selector)
        self._stopped = False
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        while not self._stopped:
            for key, _ in self._selector.select(0.02):
                key.data()

    def close(self):
        self._stopped = True
        self._thread.join()
        self._server.close()
        self._selector.close()


@pytest.mark.process
def test_topic_and_service(domain, tmp_path):
    served = Served(tmp_path / "faults")
    middleware.init()
    try:
        node = Node("twin")
        interface = FaultInterface(node, tmp_path / "faults")
        publisher = node.create_publisher(String, "twin/fault", qos.RELIABLE)
        client = node.create_client(Trigger, "twin/clear_faults")
        executor = EventsExecutor()
        executor.add_node(node)

        def until(condition):
            def spun():
                executor.spin_once(timeout_sec=0.02)
                return condition()

            wait_until(spun, "the condition")

        until(lambda: publisher.get_subscription_count() == 1 and client.service_is_ready())
        publisher.publish(String(data="fault: gremlin"))
        publisher.publish(String(data="{fault: leak, chamber: link0/chamber0, rate_1_s: 3.0}"))
        until(lambda: [str(f) for f in served.faults.active] == ["leak of link0/chamber0 (rate_1_s 3)"])
        parameters = AsyncParameterClient(node, "twin")
        until(parameters.services_are_ready)

        def inject(text):
            future = parameters.set_parameters([Parameter("fault", value=text)])
            until(future.done)
            return future.result().results[0]

        assert inject("fault: leak, chamber: link0/chamber0, rate_1_s: 5.0").successful
        assert [fault.value for fault in served.faults.active] == [3.0, 5.0]
        refused = inject("fault: gremlin")
        assert not refused.successful
        assert "gremlin" in refused.reason
        future = client.call_async(Trigger.Request())
        until(future.done)
        assert future.result().success
        assert served.faults.active == ()
        served.close()
        publisher.publish(String(data="fault: drop"))
        time.sleep(0.1)
        executor.spin_once(timeout_sec=0.5)
        future = client.call_async(Trigger.Request())
        until(future.done)
        assert "the emulator" in future.result().message
        interface.close()
        node.destroy_node()
    finally:
        rclpy.shutdown()


def test_a_run_closes_its_link_to_the_emulator_when_it_refuses_a_fault(tmp_path, monkeypatch):
    class Refusing:
        closed = 0

        def __init__(self, path):
            pass

        def inject(self, fault):
            raise HardwareError("refused")

        def close(self):
            Refusing.closed += 1

    monkeypatch.setattr(compose, "ControlClient", Refusing)
    scene = load_scene(
        "track_circle", {"faults": [{"at": 1.0, "fault": "drop"}], "controller.probe_at_enable": "off"}
    )
    run = compose.Run(scene, tmp_path, print)
    with pytest.raises(HardwareError, match="refused"):
        run.begin(None)
    assert Refusing.closed == 1
    run.end()

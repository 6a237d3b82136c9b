"""`soro vent`, `reset`, `enable`, `fault` on running nodes: two that hold air, a controller, a twin."""

import contextlib
import os
import re
import signal
import subprocess
import sys
import textwrap
import threading
import time
from pathlib import Path

import pytest
import typer
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from soro_core.errors import HardwareError, SoroError
from soro_ros.commands import services as commands
from soro_ros.commands.services import enable, fault, reset, vent
from soro_ros.conversion import qos
from soro_ros.host import services
from soro_ros.run import supervisor as supervisor_module
from soro_ros.run.supervisor import RunMonitor
from soro_ros.topics.diagnostics import ERROR, Diagnostics
from tests.patience import LIMIT_S
from tests.refused import refused, refused_keys
from tests.soro_ros.running import SORO, end, wait_until
from tests.soro_ros.test_fault_injection import Served

NODES = textwrap.dedent(
    """
    import sys, time
    import numpy as np
    from rclpy.experimental.events_executor import EventsExecutor
    from rclpy.node import Node
    from sensor_msgs.msg import JointState
    from std_srvs.srv import Trigger
    from soro_core.safety import Limiter, Limits
    from soro_ros.conversion import messages, qos
    from soro_ros.host import middleware
    from soro_ros.topics.chambers import ChamberInterface
    from soro_ros.topics.diagnostics import ERROR, OK, Diagnostics
    from soro_ros.run.faults import FaultInterface

    NAMES = ("link0/chamber0",)
    middleware.init()
    executor, ended, gone = EventsExecutor(), [], []

    def holder(namespace):
        node = Node("regulator", namespace=namespace)
        stamp_ns = lambda: node.get_clock().now().nanoseconds
        limiter = Limiter(Limits(command_age_s=0.5), NAMES)
        chambers = ChamberInterface(node, limiter, time.monotonic_ns, stamp_ns)
        diagnostics = Diagnostics(node)

        def cycle():
            limiter.slew(time.monotonic_ns())
            limiter.judge(np.zeros(1), True, time.monotonic_ns())
            if limiter.cause:
                diagnostics.update(ERROR, f"vented: {limiter.cause}")
            else:
                diagnostics.update(OK, "active")

        vented = []

        def report():
            if node in gone:  # this was due as it ended
                return
            diagnostics.publish()
            vented.extend([True] if limiter.cause else [])
            if namespace == "passing" and len(vented) == 2:  # as in a run, which ends with its arm
                ended.append(node)

        node.create_timer(0.02, cycle)
        node.create_timer(0.3, report)
        executor.add_node(node)

    def controller(namespace):
        node, asked_pa = Node("controller", namespace=namespace), [0.0]
        publisher = node.create_publisher(JointState, "chambers/command", qos.RELIABLE)

        def answer(pressure_pa, text):
            def callback(request, response):
                asked_pa[0], response.success, response.message = pressure_pa, True, text
                return response
            return callback

        node.create_service(Trigger, "~/enable", answer(1e3, "enabled"))
        node.create_service(Trigger, "~/vent", answer(0.0, "commanding zero"))
        node.create_service(Trigger, "~/reset", answer(0.0, "anew"))
        stamp_ns = lambda: node.get_clock().now().nanoseconds
        node.create_timer(
            0.02, lambda: publisher.publish(messages.chambers(NAMES, np.array(asked_pa), stamp_ns()))
        )
        executor.add_node(node)

    for namespace in sys.argv[2:]:
        holder(namespace)
    controller("left")
    twin = Node("twin", namespace="left")
    faults = FaultInterface(twin, sys.argv[1])
    executor.add_node(twin)
    print("ready", flush=True)
    while True:
        executor.spin_once(timeout_sec=1.0)
        while ended:
            node = ended.pop()
            gone.append(node)
            executor.remove_node(node)
            node.destroy_node()
    """
)


class Nodes:
    """The nodes in a process of their own, and a caller that has discovered them, which takes time."""

    def __init__(self, folder, holders) -> None:
        self.socket = folder / "faults"
        self.served = Served(self.socket)
        command = [sys.executable, "-c", NODES, str(self.socket), *holders]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE)
        if self.process.stdout.readline() != b"ready\n":
            self.close()
            raise AssertionError("the nodes do not begin")

    def close(self) -> None:
        self.process.kill()
        self.process.communicate()
        self.served.close()


@pytest.fixture
def nodes(request, domain, tmp_path, monkeypatch):
    holders = getattr(request, "param", ("left", "right"))
    nodes = Nodes(tmp_path, holders)
    try:
        with commands.service_caller() as caller:
            monkeypatch.setattr(commands, "service_caller", lambda: contextlib.nullcontext(caller))
            # As long as it takes here, and then as long as it takes at once.
            wait_until(lambda: caller.spin(0.1) or len(caller.offering("vent")) > len(holders), "discovery")
            monkeypatch.setattr(services, "FIND_S", 0.2)
            nodes.caller = caller
            yield nodes
    finally:
        nodes.close()


@pytest.mark.process
def test_vent_reset_and_enable_say_what_they_do(nodes, capfd):
    def said(command, *arguments):
        command(*arguments)
        return capfd.readouterr().out.splitlines()

    with refused("NODE", "", ("/left/regulator (active)", "/right/regulator (active)")):
        reset("")  # the controller, which has no latch, is not one of them
    assert sorted(said(vent, "")) == [
        "/left/controller: commanding zero",
        "/left/regulator: vented until ~/reset",
        "/right/regulator: vented until ~/reset",
    ]
    assert said(enable, "") == ["/left/controller: enabled"]
    with pytest.raises(SoroError, match=r"/left/regulator .*`soro vent`"):
        reset("/left/regulator")
    assert capfd.readouterr().out == "/left/regulator: vented: vent requested\n"
    assert said(vent, "controller") == ["/left/controller: commanding zero"]
    assert said(reset, "left/regulator")[1:] == ["/left/regulator: reset"]
    assert said(reset, "left/regulator")[1:] == ["/left/regulator: not latched, nothing to reset"]
    with pytest.raises(SoroError, match=r"middle .*/left/controller, /left/regulator"):
        reset("middle")


@pytest.mark.process
def test_enable_names_the_arm_that_is_still_vented(nodes, capfd):
    """The one of the controller, not another one."""
    enable("")
    assert capfd.readouterr().err == ""
    vent("")
    said = nodes.caller.status
    wait_until(lambda: nodes.caller.spin(0.05) or said["/left/regulator"].level == ERROR, "diagnostics")
    enable("")
    said = "/left/regulator: still vented: `soro vent`, `soro reset`, `soro enable`"
    assert capfd.readouterr().err.splitlines() == [said]


@pytest.mark.process
@pytest.mark.parametrize("nodes", [()], indirect=True)
def test_a_vent_that_reaches_no_valve_is_no_success(nodes, capfd):
    """As after the driver was killed: the controller still answers."""
    with pytest.raises(SoroError, match="ROS domain"):
        vent("")
    assert capfd.readouterr().out == "/left/controller: commanding zero\n"
    with pytest.raises(SoroError, match=r"~/reset .*chambers/state"):
        reset("")


@pytest.mark.process
@pytest.mark.parametrize("nodes", [("passing",)], indirect=True)
@pytest.mark.parametrize("busy", [False, True])
def test_a_run_that_ends_because_of_the_vent_did_hold_the_air(nodes, capfd, monkeypatch, busy):
    """Also where the command gets no time between its request and the end of the run."""
    name, begin = "/passing/regulator", nodes.caller.begin

    def ended():
        nodes.caller.spin(0.02)
        return name not in nodes.caller.offering("vent")

    def begin_late(node, *of_what):
        call = begin(node, *of_what)
        done = call.done

        def late():
            answered = done()  # sends the request
            wait_until(ended, "the end")
            return answered

        if node == name:
            call.done = late
        return call

    if busy:
        monkeypatch.setattr(nodes.caller, "begin", begin_late)
    monkeypatch.setattr(services, "FIND_S", 2.0)  # the search goes on after its nodes are gone
    vent("")
    assert f"{name}: vented until ~/reset" in capfd.readouterr().out
    with commands.service_caller() as caller:
        assert caller.offering("vent") == ["/left/controller"]


@pytest.mark.process
def test_a_node_that_hangs_keeps_no_command_waiting(nodes, capfd):
    nodes.process.send_signal(signal.SIGSTOP)  # one that was killed stays known, too, for some seconds
    with pytest.raises(typer.Exit) as left:
        vent("", 0.5)
    assert left.value.exit_code == 1
    said = capfd.readouterr().err
    assert "/right/regulator: service /right/regulator/vent did not answer within 0.5 s" in said
    assert said.count("did not answer") == 3


@pytest.mark.process
def test_a_fault_is_injected_or_refused_with_its_reason(nodes, capfd):
    fault("/left/twin", "fault: leak, chamber: link0/chamber0, rate_1_s: 3")
    assert [str(one) for one in nodes.served.faults.active] == ["leak of link0/chamber0 (rate_1_s 3)"]
    with pytest.raises(SoroError, match=r"^/left/twin ") as told:
        fault("/left/twin", "fault: leak, chamber: link0/chamber7")
    assert refused_keys(str(told.value)) == ["chamber"]
    fault("twin", clear=True)
    assert nodes.served.faults.active == ()
    fault(str(nodes.socket), "fault: drop, duration_s: 5")  # of an emulator that no twin knows
    assert [str(one) for one in nodes.served.faults.active] == ["drop (p 0.2)"]
    assert "/left/twin: injected fault: leak" in capfd.readouterr().out


@pytest.mark.process
def test_a_path_without_an_emulator_is_no_name_of_a_node(tmp_path):
    (tmp_path / "file").touch()
    for path in (tmp_path / "gone", tmp_path / "file", "faults.sock"):
        with pytest.raises(HardwareError, match=re.escape(str(path))) as told:
            fault(str(path), clear=True)
        assert str(told.value).startswith(f"{path}: ")


@pytest.mark.parametrize("arguments", [(None, False), ("fault: drop", True)])
def test_a_fault_or_clear_and_not_both(arguments):
    with refused("FAULT", names=("--clear",)):
        fault("twin", *arguments)


@pytest.mark.parametrize(
    ("command", "says"),
    [
        (reset, "~/reset .*{} .*soro_regulator"),
        (vent, "~/vent .*{} "),
    ],
)
def test_nobody_is_an_error_that_names_the_domain(domain, command, says):
    with pytest.raises(SoroError, match=says.format(domain)):
        command("", 0.2)


def test_a_domain_that_is_none_is_one_line(monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", "mine")
    with refused("", names=("ROS_DOMAIN_ID",)):
        reset("", 0.2)


@pytest.mark.process
def test_ctrl_c_ends_the_search(domain):
    # A fork of a warm process has the library from the start.
    process = subprocess.Popen([*SORO, "reset"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    # Once it joins ROS, amid the search of 4 s.
    wait_until(lambda: "rmw_fastrtps" in Path(f"/proc/{process.pid}/maps").read_text(), "ROS", every_s=0.001)
    status, out, err = end(process, signal.SIGINT)
    assert (status, out) == (130, "")
    assert "interrupted" in err


def test_a_run_hears_of_another_of_its_name(domain):
    with RunMonitor("arm") as supervisor:
        node = Node("regulator", namespace="arm")
        diagnostics = Diagnostics(node)
        wait_until(lambda: diagnostics.publish() or supervisor.spin(0.05) or supervisor.status, "status")
        supervisor.listen_to("regulator", os.getpid())
        supervisor.check_alone(["regulator", "recorder"])
        supervisor.listen_to("regulator", 1)
        with refused("/arm/regulator") as caught:
            supervisor.check_alone(["regulator"])
        assert str(os.getpid()) in caught.value.got
        before = supervisor.status["regulator"]
        until = time.monotonic() + 0.5
        while time.monotonic() < until:
            diagnostics.publish()
            supervisor.spin(0.05)
        assert supervisor.status["regulator"] is before, "what another says is not taken for the own node's"
        node.destroy_node()


def test_a_run_asks_again_where_the_answer_to_its_call_is_lost(domain, monkeypatch):
    monkeypatch.setattr(supervisor_module, "REPEAT_S", 0.1)
    answers = []
    with RunMonitor("alone") as supervisor:
        node = Node("twin", namespace="alone")

        def answer(request, response):
            answers.append(response)
            response.success, response.message = True, f"answer {len(answers)}"
            return response

        service = node.create_service(Trigger, "~/start", answer)
        send = service.send_response
        service.send_response = lambda response, header: len(answers) > 1 and send(response, header)
        executor = SingleThreadedExecutor()  # that of events does not send by this method
        executor.add_node(node)
        thread = threading.Thread(target=executor.spin)
        thread.start()
        try:
            assert supervisor.call("twin/start", LIMIT_S) == "answer 2"
        finally:
            executor.shutdown()
            thread.join()


@pytest.mark.process
def test_a_run_in_lockstep_hears_of_another_clock(domain):
    with RunMonitor("arm") as supervisor:
        own, other = Node("twin", namespace="arm"), Node("gazebo")
        own.create_publisher(Clock, "/clock", qos.LOCKSTEP)
        wait_until(lambda: supervisor.spin(0.05) or own.count_publishers("/clock") == 1, "the own clock")
        supervisor.check_clock()
        other.create_publisher(Clock, "/clock", 10)
        wait_until(lambda: supervisor.spin(0.05) or own.count_publishers("/clock") == 2, "the other clock")
        with refused("/clock") as caught:
            supervisor.check_clock()
        assert "/gazebo" in caught.value.got
        own.destroy_node()
        other.destroy_node()

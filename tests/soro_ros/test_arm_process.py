"""The nodes of an arm in one process: which, how they start together, how the loop runs and ends."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest
import rclpy

from soro_core.errors import ConfigError
from soro_ros.host import middleware
from soro_ros.nodes import arm
from soro_ros.nodes.twin import TwinNode
from soro_ros.run.supervisor import RunMonitor
from tests.patience import COMPILED_S
from tests.refused import refused_keys
from tests.soro_ros.running import ClockListener, end, wait_until
from tests.warm import Popen

END_S = 0.5


@pytest.mark.parametrize(
    ("arguments", "names", "rest"),
    [
        ([], ["estimator", "controller", "twin"], []),
        (["regulator", "estimator"], ["estimator", "regulator"], []),
        (["twin", "--ros-args", "-p", "x:=1"], ["twin"], ["--ros-args", "-p", "x:=1"]),
        (["--help"], ["estimator", "controller", "twin"], ["--help"]),
    ],
)
def test_nodes_start_in_one_order_whatever_the_order_of_their_names(arguments, names, rest):
    nodes, found = arm.chosen(arguments)
    assert ([node.node_name for node in nodes], found) == (names, rest)


def test_a_name_that_is_no_node_is_refused():
    with pytest.raises(ConfigError, match=r"got 'recorder'; allowed: estimator, controller, twin, regulator"):
        arm.chosen(["twin", "recorder"])


@pytest.mark.parametrize("name", ["contoller:rate_hz", "regulator:rate_hz", "/left/twin:rate_hz"])
def test_a_parameter_for_a_node_that_is_not_chosen_is_refused(name):
    with pytest.raises(ConfigError, match="for one of estimator, controller, twin"):
        arm.chosen(["--ros-args", "-p", f"{name}:=10.0"])
    for good in ("rate_hz", "twin:rate_hz"):
        arm.chosen(["--ros-args", "-p", f"{good}:=10.0"])


@pytest.mark.parametrize("namespace", ["/", "/left"])
def test_a_parameter_for_one_node_counts_in_every_namespace(domain, namespace):
    own = ("twin:limits.maximum_pa:=5e4", "twin:payload_kg:=0.02", "controller:rate_hz:=9.0")
    rules = [part for rule in own for part in ("-p", rule)]
    with arm.for_any_namespace(["--ros-args", "-r", f"__ns:={namespace}", *rules]) as arguments:
        middleware.init(arguments)
        node = TwinNode()
        try:
            values = [node.get_parameter(key).value for key in ("limits.maximum_pa", "payload_kg", "rate_hz")]
        finally:
            node.destroy_node()
            rclpy.try_shutdown()
    assert values == [5e4, 0.02, 200.0]


@pytest.mark.process
@pytest.mark.parametrize(
    ("arguments", "key"),
    [(("nothing",), "arm"), (("twin", "--ros-args", "-p", "twin:refine:=0"), "refine")],
)
def test_what_one_node_refuses_ends_the_process_in_one_line(node_main, arguments, key):
    ended = node_main("arm", *arguments)
    assert ended.status == 2, ended.err
    assert set(refused_keys(ended.err)) == {key}
    assert "Traceback" not in ended.out + ended.err


@pytest.mark.process
def test_a_node_whose_start_fails_stays_and_the_others_say_so(domain):
    command = [sys.executable, "-m", "soro_ros.nodes.arm", "estimator", "twin", "--ros-args"]
    command += ["-r", "__ns:=/one", "-p", "twin:robot:=nobody"]
    process = Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        with RunMonitor("one") as supervisor:

            def said(name: str, words: str) -> bool:
                return name in supervisor.status and words in supervisor.status[name].message

            told = {"estimator": "not started: twin has failed", "twin": "nobody"}
            wait_until(
                lambda: supervisor.spin(0.05) or all(said(*one) for one in told.items()),
                "both states",
                limit_s=COMPILED_S,
            )
            assert not any(map(supervisor.active, told))
    finally:
        status, _, err = end(process, signal.SIGINT)
    assert status == 2, err
    assert "waiting for another try: ros2 lifecycle set /one/twin configure" in err
    assert "Traceback" not in err


def test_help_names_the_nodes(node_main):
    ended = node_main("arm", "--help")
    assert ended.status == 0
    assert "soro_arm [estimator|controller|twin|regulator]..." in ended.out


@pytest.mark.process
def test_the_loop_runs_in_one_process_and_ends_by_ctrl_c(domain):
    """In lockstep: the twin goes on only while the others answer."""
    settings = (
        "mode:=lockstep",
        f"twin:duration_s:={END_S}",
        "controller:platform:=''",
        "controller:enabled:=true",
    )
    options = [part for one in settings for part in ("-p", one)]
    command = [sys.executable, "-m", "soro_ros.nodes.arm", "--ros-args", "-r", "__ns:=/one", *options]
    process = Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    clock = ClockListener()
    try:
        clock.wait(END_S, COMPILED_S)
        clock.close()
        with RunMonitor("one") as supervisor:
            names = ("estimator", "controller", "twin")
            supervisor.wait("nodes", lambda: all(map(supervisor.active, names)), lambda: None, COMPILED_S)
            assert {supervisor.values(name)["pid"] for name in names} == {str(process.pid)}
    finally:
        status, _, err = end(process, signal.SIGINT)
    assert status == 0, err
    assert "Traceback" not in err

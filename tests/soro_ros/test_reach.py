"""How far soro's processes reach: this host, every program on it, and further where the user chose so."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from soro_ros.host import middleware
from soro_ros.run.supervisor import RunMonitor
from tests.patience import COMPILED_S
from tests.soro_ros import two_hosts
from tests.soro_ros.running import SORO, end, wait_until

CHAMBERS = ["link0/chamber0", "link0/chamber1", "link0/chamber2"]


@pytest.mark.parametrize(
    ("chosen", "set_by_us"),
    [
        ({}, {"profiles": "fastdds.xml", "transports": "UDPv4"}),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": ""}, {"profiles": "fastdds.xml", "transports": "UDPv4"}),
        ({"RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"}, {"profiles": "fastdds.xml", "transports": "UDPv4"}),
        (
            {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"},
            {"profiles": "fastdds_network.xml", "transports": "UDPv4"},
        ),
        ({"ROS_STATIC_PEERS": "192.0.2.7"}, {"profiles": "fastdds_network.xml", "transports": "UDPv4"}),
        ({"ROS_DISCOVERY_SERVER": "192.0.2.7"}, {"profiles": "fastdds_network.xml", "transports": "UDPv4"}),
        ({"ROS_LOCALHOST_ONLY": "0"}, {"profiles": "fastdds_network.xml", "transports": "UDPv4"}),
        ({"FASTDDS_BUILTIN_TRANSPORTS": "LARGE_DATA"}, {"profiles": "fastdds_network.xml"}),
        ({"FASTRTPS_DEFAULT_PROFILES_FILE": "mine.xml"}, {"transports": "UDPv4"}),
        ({"FASTDDS_DEFAULT_PROFILES_FILE": "mine.xml"}, {"profiles": "mine.xml", "transports": "UDPv4"}),
    ],
)
def test_who_sets_a_variable_of_the_middleware_has_it_their_way(chosen, set_by_us):
    ours = middleware.settings(chosen)
    assert not ours.keys() & {name for name, value in chosen.items() if value}
    short = {name.split("_")[-1].lower(): Path(value).name for name, value in ours.items()}
    assert short == {"file" if name == "profiles" else name: value for name, value in set_by_us.items()}


def test_both_profiles_have_the_same_times():
    folder = Path(middleware.__file__).parent
    this_host, network = ((folder / name).read_text() for name in ("fastdds.xml", "fastdds_network.xml"))
    for start, stop in (("<leaseAnnouncement>", "</leaseAnnouncement>"), ("<data_writer", "</profiles>")):
        times = [text[text.index(start) : text.index(stop)] for text in (this_host, network)]
        assert times[0] == times[1]


_NODE = """
import sys
from rclpy.node import Node
from std_msgs.msg import String
import rclpy
name, ours = sys.argv[1], sys.argv[2] == "ours"
if ours:
    from soro_ros.host import middleware
    middleware.init()
else:
    rclpy.init()
node = Node(name, start_parameter_services=False)
heard = set()
def hear(message):
    if message.data not in heard:
        heard.add(message.data)
        print(message.data, flush=True)
node.create_subscription(String, "words", hear, 10)
publisher = node.create_publisher(String, "words", 10)
node.create_timer(0.05, lambda: publisher.publish(String(data=name)))
rclpy.spin(node)
"""

_HOSTS = f"""{two_hosts.CABLED}
env -u ROS_AUTOMATIC_DISCOVERY_RANGE "$PYTHON" node.py alone ours > alone.txt 2> alone.err &
exec "$PYTHON" node.py far ours > far.txt 2> far.err
"""


@pytest.mark.process
def test_another_host_is_reached_by_choice_only(domain, tmp_path, monkeypatch):
    """`remote` on the other host and `far` on this one have chosen to; `alone` hears `far` alone."""
    if not two_hosts.possible():
        pytest.skip("no network namespaces here (unshare, ip, nsenter)")
    for name in middleware.CHOICES:
        monkeypatch.delenv(name, raising=False)
    environment = {**os.environ, "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}
    environment |= {"PYTHON": sys.executable, "PYTHONPATH": str(Path(__file__).parents[2])}
    (tmp_path / "node.py").write_text(_NODE)
    (tmp_path / "remote.sh").write_text('exec "$PYTHON" node.py remote ours')
    hosts = subprocess.Popen([*two_hosts.ISOLATED, "bash", "-c", _HOSTS], cwd=tmp_path, env=environment)

    def heard(name: str) -> set[str]:
        file = tmp_path / f"{name}.txt"
        return set(file.read_text().split()) if file.exists() else set()

    try:
        wait_until(lambda: heard("far") == {"far", "alone", "remote"}, "what a program of both hosts hears")
        wait_until(lambda: heard("alone") >= {"alone", "far"}, "what a program of one host hears")
        time.sleep(1.5)  # three announcements
        assert heard("alone") == {"alone", "far"}
        assert heard("remote") == {"remote", "far"}
    finally:
        hosts.kill()
        hosts.wait()


def _sockets(pid: int) -> set[str]:
    """Local addresses of the UDP sockets of a process."""
    inodes = {os.readlink(link) for link in Path(f"/proc/{pid}/fd").iterdir()}
    rows = [line.split() for line in Path(f"/proc/{pid}/net/udp").read_text().splitlines()[1:]]
    own = [row[1].split(":")[0] for row in rows if f"socket:[{row[9]}]" in inodes]
    return {".".join(str(byte) for byte in reversed(bytes.fromhex(address))) for address in own}


@pytest.mark.process
def test_no_socket_of_a_node_is_open_to_the_network(domain):
    command = [sys.executable, "-c", _NODE, "node", "ours"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == "node\n"
        # The address of the group is joined on the interface of 127.0.0.1 alone.
        assert _sockets(process.pid) == {"127.0.0.1", "239.255.0.1"}
    finally:
        process.kill()
        process.communicate()


_PLAIN = """
from rclpy.node import Node
from sensor_msgs.msg import JointState
import rclpy, time
rclpy.init()
node, begin, highest = Node("plain"), time.monotonic(), 0.0
def hear(message):
    global highest
    highest = max(highest, *message.effort)
node.create_subscription(JointState, "/host/chambers/state", hear, 10)
publisher = node.create_publisher(JointState, "/host/chambers/command", 10)
def command():
    message = JointState(name={names}, effort=[20e3] * 3)
    message.header.stamp = node.get_clock().now().to_msg()
    publisher.publish(message)
node.create_timer(0.01, command)
while highest < 15e3 and time.monotonic() < begin + 30:
    rclpy.spin_once(node, timeout_sec=0.1)
print(highest)
print(*(name for name, _ in node.get_topic_names_and_types()))
"""


@pytest.mark.process
@pytest.mark.real_time
def test_a_plain_program_on_this_host_finds_every_topic_and_has_data_both_ways(domain, tmp_path):
    """As `ros2`, rosbag2 and Foxglove: ROS without a setting, in a process of its own."""
    plain = {name: value for name, value in os.environ.items() if name not in middleware.CHOICES}
    twin = [sys.executable, "-m", "soro_ros.nodes.twin", "--ros-args", "-r", "__ns:=/host"]
    twin += ["-p", "limits.command_age_s:=0.5", "-p", "priority:=0"]
    node = subprocess.Popen(twin, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        with RunMonitor("host") as supervisor:
            supervisor.wait("twin", lambda: supervisor.active("twin"), lambda: None, COMPILED_S)
            program = [sys.executable, "-c", _PLAIN.format(names=CHAMBERS)]
            done = subprocess.run(program, env=plain, capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stderr
            highest, topics = done.stdout.splitlines()
            assert float(highest) >= 15e3
            graph = supervisor.node
            known = graph.get_publisher_names_and_types_by_node("twin", "/host")
            known += graph.get_subscriber_names_and_types_by_node("twin", "/host")
            ours = {name for name, _ in known if name.startswith("/host/")}
            assert len(ours) >= 6
            assert set(topics.split()) >= {*ours, "/diagnostics"}
    finally:
        end(node)


@pytest.mark.process
@pytest.mark.parametrize(
    "command",
    [
        [sys.executable, "-m", "soro_ros.nodes.twin"],
        [*SORO, "vent"],
        [*SORO, "run", "track_circle", "--set", "mode=lockstep", "--folder", "runs", "--no-figure"],
    ],
)
def test_security_that_is_asked_for_and_missing_is_one_line(domain, command, tmp_path):
    """Without a keystore ROS goes on unprotected, with one it ends by a traceback."""
    (tmp_path / "keystore" / "enclaves").mkdir(parents=True)
    for keystore in ("", str(tmp_path / "keystore")):
        asked = {**os.environ, "ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_KEYSTORE": keystore}
        done = subprocess.run(command, env=asked, capture_output=True, text=True, check=False, cwd=tmp_path)
        assert done.returncode == 2
        (said,) = [line for line in (done.stdout + done.stderr).splitlines() if "starting" not in line]
        assert "ROS_SECURITY_ENABLE: got 'true'; allowed: false, or none, with rmw_fastrtps_cpp" in said
        assert "doesn't have the security libraries" in said

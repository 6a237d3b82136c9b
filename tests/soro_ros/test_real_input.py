"""Measured pressures of a real robot, as a bag, through player and twin, against measured curvatures."""

import subprocess
import sys

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from benchmarks.segment_runs import fit_frame
from soro_core import load_robot
from soro_core.config import find_config
from soro_lab.bag import BagReader, BagWriter, Qos, Topic
from soro_lab.identification import curvature_errors, read_forced
from soro_ros.conversion import messages
from soro_ros.conversion.interfaces import definition
from soro_ros.run.supervisor import RunMonitor
from tests.patience import LIMIT_S
from tests.soro_ros.running import end
from tests.warm import Popen

pytestmark = pytest.mark.process

STATE, TRUTH = "/replay/chambers/state", "/replay/truth/state"
JOINT_STATE = "sensor_msgs/msg/JointState"
START_NS = 1_000_000_000


def write_bag(folder, run, names) -> None:
    """Measured pressures as chambers/state, as the regulator node would have recorded them."""
    known = definition(JOINT_STATE)
    with BagWriter(folder) as bag:
        qos = (Qos(history="keep_last", depth=100),)
        bag.add_topic(Topic(STATE, JOINT_STATE, known.text, known.encoding, known.type_hash, qos))
        for t, pressure in zip(run.t, run.pressure, strict=True):
            stamp_ns = START_NS + round(float(t) * 1e9)
            message = messages.chambers(names, pressure, stamp_ns)
            bag.write(STATE, serialize_message(message), stamp_ns)


def node(name: str, *parameters: str) -> subprocess.Popen[str]:
    options = [option for parameter in parameters for option in ("-p", parameter)]
    command = [sys.executable, "-m", f"soro_ros.nodes.{name}", "--ros-args", "-r", "__ns:=/replay", *options]
    return Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_measured_pressures_through_player_and_twin_give_the_measured_curvatures(
    domain, data, tmp_path, figure
):
    run = read_forced(data / "tue_three_bellow" / "forced_p123.csv")
    robot = load_robot(find_config("tue_three_bellow", "robots"))
    write_bag(tmp_path / "measured", run, robot.chamber_names)

    twin = node(
        "twin", "pressures:=measured", "rate_hz:=250.0", "refine:=1", "pose.enabled:=false", "step_s:=0.004"
    )
    recorder = node("recorder", f"folder:={tmp_path / 'replayed'}", f"topics:=['{TRUTH} {JOINT_STATE}']")
    player = None
    try:
        with RunMonitor("replay") as supervisor:
            supervisor.wait(
                "twin and recorder",
                lambda: supervisor.active("twin") and supervisor.active("recorder"),
                lambda: None,
                120,
            )
            player = node(
                "player", f"bag:={tmp_path / 'measured'}", "rate:=0.0", "wait_for_subscribers:=true"
            )
            last = len(run.t) - 1
            supervisor.wait(
                "end of the replay",
                lambda: int(supervisor.values("twin").get("tick", 0)) >= last,
                lambda: None,
                120,
            )
            bridged = int(supervisor.values("twin")["bridged_ticks"])
            supervisor.wait(
                "recorded samples",
                lambda: int(supervisor.values("recorder").get("messages", 0)) >= len(run.t),
                lambda: None,
                120,
            )
        output = player.communicate(timeout=LIMIT_S)
        assert player.returncode == 0, output
    finally:
        results = [end(process) for process in (recorder, twin)]
        if player is not None:
            end(player)
    assert [status for status, _, _ in results] == [0, 0], results

    t, curvature = read_curvatures(tmp_path / "replayed")
    # Every sample has been played, at its own time; only gaps of the recording itself were bridged.
    assert bridged == np.sum(np.round(np.diff(run.t) / 0.004) - 1)
    assert len(t) >= len(run.t)
    assert t[[0, -1]] == pytest.approx(run.t[[0, -1]], abs=1e-6)
    curvature = np.column_stack([np.interp(run.t, t, column) for column in curvature.T])
    fitted, held_out = run.t < 12.0, run.t >= 12.0
    frame = fit_frame(run.curvature[fitted], curvature[fitted])
    errors = curvature_errors(run.curvature[held_out], curvature[held_out], frame.rotation, frame.offset)
    offset = ", ".join(f"{value:.3f}" for value in frame.offset)
    figure(f"replay: frame fitted on the first 12 s: rotation {frame.rotation:.3f} rad, offset {offset} 1/m")
    figure(
        f"replay, 12 to 24 s: vector RMS {errors.vector:.3f} 1/m, magnitude RMS {errors.magnitude:.3f} 1/m"
    )
    assert errors.vector <= 0.35
    assert errors.magnitude <= 0.21


def read_curvatures(bag) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] and curvatures (n, 2) [1/m] of the twin."""
    rows = []
    with BagReader(bag) as reader:
        for item in reader.messages({TRUTH}):
            message = deserialize_message(item.data, JointState)
            at = dict(zip(message.name, message.position, strict=True))
            stamp = (messages.to_ns(message.header.stamp) - START_NS) * 1e-9
            rows.append((stamp, at["link0/bending_x"], at["link0/bending_y"]))
    table = np.array(rows)
    return table[:, 0], table[:, 1:]

"""`soro grasp`: its exit status, and a hand of real nodes that squeezes, holds and opens."""

from types import SimpleNamespace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from soro_ros.conversion import messages
from soro_ros.run.grasp_client import Grasper
from tests.patience import COMPILED_S, patient_platform
from tests.soro_ros.direct import receive
from tests.soro_ros.running import SORO, ClockListener, end, only_run, payloads, run, start_run
from tests.warm import completed

SCENE = "grasp_ball"


class ScriptedHand:
    """A caller whose hand reports what a test says, from the first request on."""

    def __init__(self, node, *states, refusal="", vented=""):
        self.node, self.states, self.asked, self._refusal = node, list(states), [], refusal
        self.status = {"/arm/regulator": SimpleNamespace(message=vented or "active")}

    def spin(self, seconds):
        if not (self.states and self.asked):
            return
        if (name := self.states.pop(0)) == "interrupt":
            raise KeyboardInterrupt
        values = {"force_n": "0.05", "pressure_pa": "20000"}
        pairs = [KeyValue(key=key, value=value) for key, value in values.items()]
        receive(self.node, "/arm/hand/grasp", DiagnosticStatus(name=name, message="why", values=pairs))

    def call(self, node, service, kind, request, limit_s):
        self.asked.append(service)
        return SimpleNamespace(success=not self._refusal, message=self._refusal)


def grasped(node, *states, hold_s=0.0, **changes):
    caller, said = ScriptedHand(node, *states, **changes), []
    grasper = Grasper(caller, "/arm/hand", 0.2, said.append)
    return grasper.grasp(hold_s), caller.asked, said


@pytest.mark.parametrize(
    ("states", "hold_s", "status", "asked"),
    [
        (("closing", "squeezing", "holding", "opening", "open"), 0.0, 0, ["close", "open"]),
        (("closing", "squeezing", "holding"), None, 0, ["close"]),
        (("closing", "lost", "opening"), 0.0, 1, ["close"]),
        (("closing", "vented"), 0.0, 1, ["close"]),
        (("holding", "slipping", "lost"), 5.0, 1, ["close"]),
        (("closing",), 0.0, 1, ["close", "open"]),  # and no more is heard
    ],
)
def test_the_exit_status_is_that_of_the_grasp(node, states, hold_s, status, asked):
    assert grasped(node, *states, hold_s=hold_s)[:2] == (status, asked)


def test_what_slips_to_the_end_is_not_held_and_let_go(node):
    status, asked, said = grasped(node, "holding", "slipping", hold_s=0.1)
    assert (status, asked) == (1, ["close", "open"])
    assert "lost: still slipping after 0.1 s" in said


def test_a_refusal_is_status_2(node):
    status, asked, said = grasped(node, refusal="thumb is not in control: soro enable")
    assert (status, asked) == (2, ["close"])
    assert said == ["refused: thumb is not in control: soro enable"]


def test_ctrl_c_opens(node):
    caller = ScriptedHand(node, "closing", "interrupt")
    with pytest.raises(KeyboardInterrupt):
        Grasper(caller, "/arm/hand", 0.2, print).grasp(5.0)
    assert caller.asked == ["close", "open"]


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        (("--force", "10mm"), ("--force", "mN")),
        (("--crush", "-1N"), ("--crush",)),
        (("open", "--force", "10mN"), ("open", "alone")),
        (("--duration", "long"), ("--duration",)),
    ],
)
def test_wrong_use_is_one_line(soro, arguments, names):
    status, _, err = soro("grasp", *arguments)
    assert status == 2
    (line,) = err.splitlines()
    assert all(name in line for name in names), line


@pytest.mark.parametrize(
    ("change", "names"),
    [
        ("controller.gains={k_p: [0.1, 0.1, 0.1], k_d: [0.0, 0.0, 0.0]}", ("thumb", "gains of 0")),
        ("hand.closing=[1.0, 0.0]", ("closing", "3 numbers")),
        ("hand.squeeze.force_n=1N", ("force_n = 1", "none above the next one")),
        ("hand.tracked=bodies/bal/pose", ("hand.tracked", "bodies/ball/pose")),
        ("hand.touch_m=1.0", ("touch_m", "up to 0.064 m")),
    ],
)
def test_a_hand_that_cannot_be_is_refused_in_one_line(domain, tmp_path, soro, change, names):
    status, out, err = soro(
        "run", SCENE, "--set", "mode=lockstep", "--set", change, "--folder", str(tmp_path)
    )
    assert status == 2, out + err
    line = next(line for line in (out + err).splitlines() if names[0] in line)
    assert all(name in line for name in names), line


@pytest.mark.process
def test_nodes_of_a_hand_squeeze_hold_and_open(domain, tmp_path):
    platform = patient_platform(tmp_path, real_time=False, name="emulated_three_fingers")
    changes = "mode=lockstep", f"platform={platform}", "duration_s=600", "hand.close_at_s=0"
    runs = tmp_path / "runs"
    running = start_run(runs, *changes, "bodies.table.motion=null", scene=SCENE)
    try:
        clock = ClockListener()
        clock.wait(1.0, COMPILED_S)
        clock.close()
        refusal = grasp("--crush", "1mN")
        assert refusal.returncode == 2
        assert "none above the next one" in refusal.stdout + refusal.stderr
        held = grasp("--duration", "500ms", "--force", "20mN")
        assert held.returncode == 0, held.stdout + held.stderr
        assert [line.split(":")[0] for line in held.stdout.splitlines()][-1] == "open"
        assert "holding: holds" in held.stdout
        kept = grasp("keep", "--force", "40mN")
        assert kept.returncode == 0, kept.stdout + kept.stderr
        opened = grasp("open")
        assert opened.returncode == 0, opened.stdout + opened.stderr
    finally:
        end(running)
    heard = payloads(only_run(runs) / "bag")
    normal = [
        sum(one.effort)
        for data in heard[f"/{SCENE}/bodies/contacts"]
        for one in [of_fingers(deserialize_message(data, JointState))]
    ]
    assert 0.1 < max(normal) < 0.3  # three fingers of some 40 mN
    assert normal[-1] == 0.0


@pytest.mark.process
def test_a_hand_squeezes_harder_while_the_ball_slips_and_says_where_it_meets_nothing(domain, tmp_path):
    platform = patient_platform(tmp_path, real_time=False, name="emulated_three_fingers")
    motion = "{at_s: [4.0, 7.0, 7.5], displacement_m: [[0, 0, 0], [0, 0, -0.003], [0, 0, -0.030]]}"
    changes = "mode=lockstep", f"platform={platform}", "duration_s=10"
    status, output, folder = run(
        tmp_path / "held", *changes, f"bodies.table.motion={motion}", "bodies.ball.mass=15g", scene=SCENE
    )
    assert status == 0, output
    heard = payloads(folder / "bag")
    phases = [deserialize_message(one, DiagnosticStatus).name for one in heard[f"/{SCENE}/hand/grasp"]]
    order = [phases.index(one) for one in ("closing", "squeezing", "holding", "slipping")]
    assert order == sorted(order)
    poses = [deserialize_message(one, PoseStamped) for one in heard[f"/{SCENE}/bodies/ball/pose"]]
    at_end = next(one for one in poses if messages.to_ns(one.header.stamp) >= 9.9e9)
    assert at_end.pose.position.z > -0.066  # the table is 30 mm below
    gone = "bodies.ball.position=[0.0, 0.0, -0.13]", "hand.squeeze.most_pa=20kPa"
    status, output, folder = run(tmp_path / "missed", *changes, *gone, scene=SCENE)
    said = [
        deserialize_message(one, DiagnosticStatus) for one in payloads(folder / "bag")[f"/{SCENE}/hand/grasp"]
    ]
    lost = [one.message for one in said if one.name == "lost"]
    assert lost == ["a finger has met nothing: opens"], output


def of_fingers(message):
    names = [name for name in message.name if "table" not in name]
    values = np.array([message.effort[message.name.index(name)] for name in names if "ball" in name])
    return JointState(name=names, effort=values.tolist())


def grasp(*arguments):
    return completed([*SORO, "grasp", *arguments, "--timeout", "30s"], 200)

"""`soro grasp`: its exit status, and a hand of real nodes that squeezes, holds and opens."""

from subprocess import PIPE
from types import SimpleNamespace

import pytest
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from soro_core.errors import SoroError
from soro_ros.conversion import messages
from soro_ros.host.services import ServiceCaller
from soro_ros.run.grasp_client import Grasper
from tests.patience import COMPILED_S, patient_platform
from tests.soro_ros.direct import receive
from tests.soro_ros.running import SORO, ClockListener, end, only_run, payloads, run, start_run
from tests.warm import Popen, completed

SCENE = "grasp_ball"


class ScriptedHand:
    """A caller whose hand reports what a test says, from the first request on."""

    def __init__(self, node, *states, refusal="", vented="", deaf=""):
        self.node, self.states, self.asked, self._refusal = node, list(states), [], refusal
        self._deaf = deaf
        self.status = {"/arm/regulator": SimpleNamespace(message=vented or "active")}

    def spin(self, seconds):
        if not (self.states and self.asked):
            return
        is_repeated = self.states[1:] == ["for ever"]
        if (name := self.states[0] if is_repeated else self.states.pop(0)) == "interrupt":
            raise KeyboardInterrupt
        values = {"force_n": "0.05", "pressure_pa": "20000"}
        pairs = [KeyValue(key=key, value=value) for key, value in values.items()]
        receive(self.node, "/arm/hand/grasp", DiagnosticStatus(name=name, message="why", values=pairs))

    def call(self, node, service, kind, request, limit_s):
        self.asked.append(service)
        if service == self._deaf:
            raise SoroError(f"service {service} did not answer within {limit_s:g} s")
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


@pytest.mark.parametrize(
    ("states", "deaf", "last"),
    [
        (("closing", "interrupt"), "", "interrupted: the hand opens"),
        (("holding", "opening", "interrupt"), "", "interrupted: the hand opens"),
        (("closing", "interrupt"), "open", "the hand may go on to close or hold: soro grasp open"),
    ],
)
def test_ctrl_c_opens_and_says_what_the_hand_does(node, states, deaf, last):
    caller, said = ScriptedHand(node, *states, deaf=deaf), []
    with pytest.raises(KeyboardInterrupt):
        Grasper(caller, "/arm/hand", 0.2, said.append).grasp(5.0)
    assert caller.asked == ["close", "open"]
    assert said[-1].endswith(last)


def test_each_ctrl_c_interrupts_one_wait(domain):
    """What is asked for after the first is sent, and waited for."""
    signals = [2]
    with ServiceCaller(lambda: len(signals)) as caller:
        for _ in range(2):
            with pytest.raises(KeyboardInterrupt):
                caller.spin(0.01)
            caller.spin(0.01)
            signals.append(2)


def test_a_hand_whose_reports_bring_nothing_new_is_given_up(node):
    status, asked, said = grasped(node, "squeezing", "for ever")
    assert (status, asked) == (1, ["close", "open"])
    assert said[-2:] == [
        "lost: still squeezing, its pressures stand for 0.2 s",
        "gives up: the hand opens",
    ]


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
    # between two commands passes any time: a ball would roll off its table
    cylinder = "bodies.ball.shape={kind: cylinder, radius: 16mm, length: 32mm}"
    running = start_run(runs, *changes, "bodies.table.motion=null", cylinder, scene=SCENE)
    try:
        clock = ClockListener()
        clock.wait(1.0, COMPILED_S)
        clock.close()
        refusal = grasp("--crush", "1mN")
        assert refusal.returncode == 2
        assert "none above the next one" in refusal.stdout + refusal.stderr
        # The noise of the poses ends a squeeze some 12 mN early or late: a force of many times that.
        kept = grasp("keep", "--force", "200mN")
        assert kept.returncode == 0, kept.stdout + kept.stderr
        opened = grasp("open")
        assert opened.returncode == 0, opened.stdout + opened.stderr
        held = grasp("--duration", "500ms", "--force", "20mN")
        assert held.returncode == 0, held.stdout + held.stderr
        assert [line.split(":")[0] for line in held.stdout.splitlines()][-1] == "open"
        assert "holding: holds" in held.stdout
        interrupted = Popen([*SORO, "grasp", "--duration", "600s"], stdout=PIPE, stderr=PIPE, text=True)
        said = next(line for line in interrupted.stdout if line.startswith("holding"))
        status, out, err = end(interrupted)
        assert (status, out.splitlines()[-1]) == (130, "interrupted: the hand opens"), said + out + err
        for _ in range(2):  # waits until it is; one that is open says so at once
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
    assert max(normal) == pytest.approx(0.6, rel=0.3)  # three fingers of 200 mN
    assert normal[-1] == 0.0


@pytest.mark.process
def test_a_hand_squeezes_harder_while_the_ball_slips(domain, tmp_path):
    motion = "{at_s: [3.5, 5.5, 6.0], displacement_m: [[0, 0, 0], [0, 0, -0.003], [0, 0, -0.030]]}"
    changes = "mode=lockstep", "platform=", "duration_s=7.5", f"bodies.table.motion={motion}"
    status, output, folder = run(tmp_path / "runs", *changes, "bodies.ball.mass=15g", scene=SCENE)
    assert status == 0, output
    heard = payloads(folder / "bag")
    phases = [deserialize_message(one, DiagnosticStatus).name for one in heard[f"/{SCENE}/hand/grasp"]]
    order = [phases.index(one) for one in ("closing", "squeezing", "holding", "slipping")]
    assert order == sorted(order)
    poses = [deserialize_message(one, PoseStamped) for one in heard[f"/{SCENE}/bodies/ball/pose"]]
    at_end = next(one for one in poses if messages.to_ns(one.header.stamp) >= 7.4e9)
    assert at_end.pose.position.z > -0.066  # the table is 30 mm below


@pytest.mark.process
def test_a_hand_that_meets_nothing_says_so(domain, tmp_path):
    changes = (
        "platform=",
        "duration_s=3.5",
        "bodies.ball.position=[0.0, 0.0, -0.13]",
        "hand.squeeze.most_pa=20kPa",
    )
    _, output, folder = run(tmp_path / "runs", "mode=lockstep", *changes, scene=SCENE)
    heard = payloads(folder / "bag")[f"/{SCENE}/hand/grasp"]
    said = [deserialize_message(one, DiagnosticStatus) for one in heard]
    lost = [one.message for one in said if one.name == "lost"]
    assert lost == ["a finger has met nothing: opens"], output


@pytest.mark.process
def test_a_ball_that_needs_more_than_the_crush_limit_is_lost_and_not_crushed(domain, tmp_path):
    crush = 0.06
    motion = "{at_s: [3.0, 7.0, 7.5], displacement_m: [[0, 0, 0], [0, 0, -0.006], [0, 0, -0.040]]}"
    changes = "platform=", f"hand.squeeze.crush_n={crush}", f"bodies.table.motion={motion}"
    _, output, folder = run(tmp_path / "runs", "mode=lockstep", "duration_s=8", *changes, scene=SCENE)
    heard = payloads(folder / "bag")
    said = [deserialize_message(one, DiagnosticStatus) for one in heard[f"/{SCENE}/hand/grasp"]]
    lost = [one.message for one in said if one.name == "lost"]
    assert lost == ["the object is gone, the crush limit is too low to hold it: opens"], output
    assert any("at the crush limit: 51 mN" in one.message for one in said)
    normal = [
        max(of_fingers(deserialize_message(one, JointState)).effort, default=0.0)
        for one in heard[f"/{SCENE}/bodies/contacts"]
    ]
    assert 0.5 * crush < max(normal) < crush


def of_fingers(message):
    forces = dict(zip(message.name, message.effort, strict=True))
    kept = [pair for pair in forces if "ball" in pair and not {"table", "floor"} & set(pair.split("/"))]
    return JointState(name=kept, effort=[forces[pair] for pair in kept])


def grasp(*arguments):
    return completed([*SORO, "grasp", *arguments, "--timeout", "30s"], 200)

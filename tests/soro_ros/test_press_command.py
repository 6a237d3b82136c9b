"""`soro press`: what it sends, its exit status, and a press on the wall of a twin by real nodes."""

import contextlib
from types import SimpleNamespace

import numpy as np
import pytest
import typer
from geometry_msgs.msg import WrenchStamped
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from typer.testing import CliRunner

from soro_ros.commands import move
from soro_ros.conversion.force import force_of
from soro_ros.run import motion_client as moving
from tests.patience import COMPILED_S
from tests.refused import refused
from tests.soro_ros.direct import captured
from tests.soro_ros.running import SORO, ClockListener, end, only_run, payloads, start_run
from tests.soro_ros.test_move_command import Scripted
from tests.warm import completed

CAP, TARE, SPEED = (f"control.force.{key}" for key in ("cap_n", "tare", "approach_speed_m_s"))


def pressed(node, *states, hold_s=0.0):
    caller, said = Scripted(node, *states), []
    presser = moving.Presser(caller, "/arm/controller", 0.3, said.append)
    caller.sent = captured(node, "/arm/arm/reference/wrench")
    return presser.press(np.array([0.0, 0.05, 0.0]), hold_s), said, caller.sent


def forces(sent):
    return [(one.wrench.force.x, one.wrench.force.y, one.wrench.force.z) for one in sent]


def test_a_force_is_held_and_then_released(node):
    states = ("moving", "approaches"), ("moving", "in contact"), ("reached", "presses with 50.0 mN")
    status, said, sent = pressed(node, *states, ("reached", ""))
    assert status == 0
    assert forces(sent) == [(0.0, 0.05, 0.0), (0.0, 0.0, 0.0)]
    assert [line.split(":")[0] for line in said] == ["moving", "reached", "reached"]


@pytest.mark.parametrize(("end", "status"), [("lost", 1), ("refused", 2), ("replaced", 1), ("vented", 1)])
def test_the_exit_status_is_that_of_the_end_and_a_lost_press_releases(node, end, status):
    found, said, sent = pressed(node, ("moving", ""), (end, "why"))
    assert found == status
    assert forces(sent) == [(0.0, 0.05, 0.0), *([(0.0, 0.0, 0.0)] if end == "lost" else [])]
    assert said[-1].startswith(f"{end}: why")


def test_a_force_that_is_lost_while_it_is_held_is_status_1(node):
    status, said, sent = pressed(node, ("reached", ""), ("lost", "the force is 0 mN"), hold_s=5.0)
    assert (status, said[-1].split(",")[0]) == (1, "lost: the force is 0 mN")
    assert forces(sent)[-1] == (0.0, 0.0, 0.0)


class Keyed(Scripted):
    """A controller with parameters, which reports as `Scripted`."""

    def __init__(self, node, *states):
        super().__init__(node, *states)
        self.keys = {CAP: 0.2, TARE: True, SPEED: 0.005}
        self.set = []

    def call(self, controller, service, kind, request, limit_s):
        if service == "get_parameters":
            values = [Parameter(key, value=self.keys[key]).get_parameter_value() for key in request.names]
            return SimpleNamespace(values=values)
        changes = {one.name: Parameter.from_parameter_msg(one).value for one in request.parameters}
        self.set.append(changes)
        refused = changes.get(SPEED, 0.0) > 1.0
        if not refused:
            self.keys.update(changes)
        return SimpleNamespace(result=SimpleNamespace(successful=not refused, reason="at most 1"))


@pytest.mark.parametrize(
    ("end", "arguments", "during", "after"),
    [
        ("refused", ("--cap", "80mN"), {CAP: 0.08}, {}),
        ("reached", ("--cap", "80mN"), {CAP: 0.08}, {CAP: 0.08}),
        ("lost", ("--cap", "80mN", "--no-tare"), {CAP: 0.08, TARE: False}, {CAP: 0.08}),
        ("reached", (), None, {}),  # a tare of the scene stays
    ],
)
def test_parameters_of_a_refused_press_and_a_tare_are_taken_back(
    node,
    monkeypatch,
    end,
    arguments,
    during,
    after,
):
    caller = Keyed(node, ("moving", ""), (end, "why"), ("reached", ""))
    before = dict(caller.keys)

    def start(presser):
        caller.sent = captured(node, "/arm/arm/reference/wrench")

    monkeypatch.setattr(move, "service_caller", lambda: contextlib.nullcontext(caller))
    monkeypatch.setattr(move, "one_node", lambda *given: "/arm/controller")
    monkeypatch.setattr(moving.Presser, "start", start)
    app = typer.Typer()
    app.command()(move.press)
    CliRunner().invoke(app, ["50mN", "0", "1", "0", "--duration", "0s", *arguments])
    assert (caller.set[0] if caller.set else None) == during
    assert caller.keys == before | after


def test_of_refused_parameters_none_is_set(node):
    caller = Keyed(node)
    presser = moving.Presser(caller, "/arm/controller", 0.3, print)
    with (
        refused(f"{CAP}, {SPEED}", names=("at most 1",)),
        presser.configured({CAP: 0.1, SPEED: 2.0}),
    ):
        raise AssertionError("pressed")
    assert caller.keys[CAP] == 0.2


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        (("100mm", "1", "0", "0"), ("FORCE", "'100mm'", "mN")),
        (("-5mN", "1", "0", "0"), ("FORCE", "'-5mN'")),
        (("50mN", "1", "0"), ("X Y Z", "three numbers")),
        (("50mN", "0", "0", "0"), ("X Y Z", "not all 0")),
        (("50mN", "0", "0", "1", "--cap", "1kg"), ("--cap", "mN")),
    ],
)
def test_wrong_use_is_one_line(soro, arguments, names):
    status, _, err = soro("press", *arguments)
    assert status == 2
    (line,) = err.splitlines()
    assert all(name in line for name in names), line


@pytest.mark.process
def test_nodes_press_on_a_wall_and_say_where_there_is_none(domain, tmp_path):
    wall = "{stiffness: 2000, damping: 1, friction: 0.3, normal: [-1, 0, 0], point: [0.016, 0, 0]}"
    changes = (
        "mode=lockstep",
        "platform=",
        "duration_s=600",
        "twin.payload_kg=0",
        f"twin.wall={wall}",
        "controller.reference={kind: set_point, set_point: [0.06, 0.0, 0.0], start_s: 1.0}",
    )
    run = start_run(tmp_path, *changes)
    try:
        clock = ClockListener()
        clock.wait(4.0, COMPILED_S)
        clock.close()
        none = press("60mN", "-1", "0", "0", "--approach", "500ms")
        assert none.returncode == 1, none.stdout + none.stderr
        assert "lost: no contact within 0.5 s" in none.stdout
        some = press(
            "60mN", "1", "0", "0", "--duration", "500ms", "--approach", "5s", "--approach-speed", "10mm/s"
        )
        assert some.returncode == 0, some.stdout + some.stderr
        assert "reached: presses with" in some.stdout
        refusal = press("60mN", "1", "0", "0", "--cap", "0.01mN")
        assert refusal.returncode == 2
        assert "cap" in refusal.stdout + refusal.stderr
        # A cap that stays after the refusal would refuse this one, too.
        again = press("60mN", "1", "0", "0", "--duration", "0s", "--tare")
        assert again.returncode == 0, again.stdout + again.stderr
    finally:
        end(run)
    bag = only_run(tmp_path) / "bag"
    true = [deserialize_message(data, WrenchStamped) for data in payloads(bag)["/track_circle/truth/wrench"]]
    assert 0.05 < max(-force_of(one)[0] for one in true) < 0.08


def press(*arguments):
    return completed([*SORO, "press", *arguments], 120)

"""Parameters of running nodes: taken over at once, or refused with what has to be done."""

import math

import numpy as np
import pytest
import rclpy
import yaml
from pydantic.fields import FieldInfo
from rclpy.parameter import Parameter, parameter_dict_from_yaml_file

from soro_core.config import Floats
from soro_core.twin.config import TwinConfig
from soro_lab.scene import ControllerNodeConfig
from soro_ros.conversion import messages
from soro_ros.host import middleware
from soro_ros.nodes.controller import ControllerNode
from soro_ros.nodes.estimator import EstimatorNode
from soro_ros.nodes.twin import TwinNode
from soro_ros.process import parameters
from soro_ros.process.parameter_values import READ_ONLY, as_given, descriptor
from tests.soro_ros.direct import receive, request

NAMES = ["link0/elongation", "link0/bending_x", "link0/bending_y"]
CHAMBERS = ["link0/chamber0", "link0/chamber1", "link0/chamber2"]
NUMBER = {"publication_sequence_number": None}


@pytest.fixture
def started(domain):
    """Start a node in this process with a command line, configured and active."""
    made = []

    def start(node_class, *arguments):
        if not made:
            middleware.init(["--ros-args", *arguments])
        node = node_class()
        made.append(node)
        node.trigger_configure()
        assert node.failure is None
        node.trigger_activate()
        return node

    yield start
    for node in made:
        node.make_safe()
    rclpy.try_shutdown()


def set_one(node, name, value):
    (result,) = node.set_parameters([Parameter(name, value=value)])
    return result


def tick(node, number, q=(0.0, 0.0, 0.0)):
    stamp_ns = number * 5_000_000
    receive(node, "chambers/state", messages.chambers(CHAMBERS, np.full(3, 20e3), stamp_ns))
    zero = np.zeros(3)
    receive(node, "arm/state", messages.arm_state(NAMES, np.array(q), zero, zero, stamp_ns))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "value"),
    [("robot", "six_link"), ("rate_hz", 100.0), ("control.law", "adaptive"), ("model.links", 2)],
)
def test_what_only_the_next_configuration_uses_is_refused_until_the_node_is_cleaned_up(started, name, value):
    node = started(ControllerNode)
    before = node.get_parameter(name).value
    result = set_one(node, name, value)
    assert not result.successful
    assert "takes effect at the next configure" in result.reason
    assert name.removeprefix("control.") in result.reason
    assert node.get_parameter(name).value == before
    assert set_one(node, name, before).successful  # no change
    node.trigger_deactivate()
    assert not set_one(node, name, value).successful
    node.trigger_cleanup()
    assert set_one(node, name, value).successful
    node.trigger_configure()
    assert parameters.overrides(node._used)[name] == value


def test_a_node_without_live_parameters_refuses_all_of_them(started):
    node = started(EstimatorNode)
    assert not set_one(node, "filter.pressure_std_pa", 200.0).successful
    assert not set_one(node, "filter.pressure_std_pa", -1.0).successful


def test_gains_adaptation_and_reference_act_at_once_on_what_is_learned(started):
    settings = ("mode:=lockstep", "control.law:=adaptive", "control.reference.start_s:=0.1")
    node = started(ControllerNode, *(part for setting in settings for part in ("-p", setting)))
    assert request(node, "~/enable").success
    for number in range(1, 40):
        tick(node, number)
    state = node.state
    assert set_one(node, "control.adapt", False).successful
    assert set_one(node, "control.gains.k_p", [5.0, 1e-3, 1e-3]).successful
    assert not node.controller.config.adapt
    assert node.controller.config.gains.k_p == (5.0, 1e-3, 1e-3)
    assert node.state.law is state.law
    assert set_one(node, "control.reference.kind", "circle").successful
    for number in range(40, 200):
        tick(node, number)
    assert np.abs(node.state.point.qd).max() > 0.1
    result = set_one(node, "control.reference.curvature_per_m", 500.0)
    assert "curvature_per_m" in result.reason
    assert node.get_parameter("control.reference.curvature_per_m").value == 10.0
    assert node.controller.config.reference.curvature_per_m == 10.0
    assert set_one(node, "limits.maximum_pa", 30000).successful
    assert node.controller.maximum_pa.tolist() == [30e3] * 3
    assert not set_one(node, "limits.maximum_pa", 95e3).successful
    # Until the node is configured anew, the limits of the start may come back.
    assert set_one(node, "limits.maximum_pa", 90e3).successful


def test_a_twin_keeps_pressures_within_narrower_limits_without_a_vent(started):
    node = started(TwinNode, "-p", "mode:=lockstep")

    def run(first, last):
        for number in range(first, last):
            stamp_ns = number * 5_000_000
            receive(node, "chambers/command", messages.chambers(CHAMBERS, np.full(3, 60e3), stamp_ns), NUMBER)

    run(0, 200)
    assert node._limiter.state.setpoint_pa.tolist() == [60e3] * 3
    assert set_one(node, "limits.maximum_pa", 20000).successful
    run(200, 205)
    assert node._limiter.state.setpoint_pa[0] > 45e3
    run(205, 400)
    assert node._limiter.state.setpoint_pa.tolist() == [20e3] * 3
    assert node._limiter.cause is None
    assert node.get_parameter("limits.maximum_pa").value == 20e3
    assert "over_pressure_pa" in set_one(node, "limits.over_pressure_pa", 95e3).reason


def dumped(node):
    """What `ros2 param dump` prints."""
    values = {name: one.value for name, one in node.get_parameters_by_prefix("").items()}
    plain = {n: list(v) if hasattr(v, "tolist") or isinstance(v, tuple) else v for n, v in values.items()}
    return yaml.dump({f"/{node.get_name()}": {"ros__parameters": parameters.nested(plain)}})


@pytest.mark.parametrize("node_class", [ControllerNode, EstimatorNode])
def test_an_own_dump_loads_again_into_the_running_node_and_into_a_new_one(started, tmp_path, node_class):
    given = (
        "filter.pressure_std_pa:=1e-07"
        if node_class is EstimatorNode
        else "control.gains.k_d:=[1e-07,0.1,1.0]"
    )
    node = started(node_class, "-p", given)
    config, file = node._used, tmp_path / "dump.yaml"
    file.write_text(dumped(node))
    assert "1.0e-0" in file.read_text()
    for name, message in parameter_dict_from_yaml_file(str(file)).items():  # as `ros2 param load`
        if name in READ_ONLY or name in ("use_sim_time", "start_type_description_service"):
            continue
        (result,) = node.set_parameters([Parameter.from_parameter_msg(message)])
        assert result.successful, result.reason
    assert node._used == config
    rclpy.shutdown()
    middleware.init(["--ros-args", "--params-file", str(file)])
    again = node_class()
    assert parameters.read(again, node_class.config_model) == config
    again.destroy_node()


def test_parameters_say_what_they_allow(started):
    node = started(ControllerNode)
    rate = node.describe_parameter("rate_hz")
    assert (rate.floating_point_range[0].from_value, rate.floating_point_range[0].to_value) == (0.001, 1000.0)
    assert "ticks of the control loop" in rate.description
    types = {
        "rate_hz": 3,
        "model.links": 2,
        "mode": 4,
        "enabled": 1,
        "pose_locations": 8,
    }
    assert {name: node.describe_parameter(name).type for name in types} == types
    (count,) = node.describe_parameter("model.links").integer_range
    assert (count.from_value, count.to_value) == (1, 64)
    assert node.describe_parameter("mode").additional_constraints == "real_time, lockstep"
    kind = node.describe_parameter("control.reference.kind")
    assert kind.additional_constraints == "circle, set_point, path, hold"
    assert not kind.read_only
    assert all(node.describe_parameter(name).read_only for name in READ_ONLY)
    for name in READ_ONLY:
        assert not set_one(node, name, 1).successful
    assert not any(
        "`" in node.describe_parameter(name).description for name in node.get_parameters_by_prefix("")
    )


@pytest.mark.parametrize("model", [ControllerNodeConfig, TwinConfig])
def test_every_default_lies_within_its_range(model):
    for name, (default, field) in parameters._flatten(model):
        found = descriptor(name, field)
        for bounds in (*found.floating_point_range, *found.integer_range):
            assert default is None or bounds.from_value <= default <= bounds.to_value, name


@pytest.mark.parametrize(
    ("annotation", "given", "value"),
    [
        (float, 200, 200.0),
        (float, "1e-07", 1e-07),
        (float, "fast", "fast"),
        (float | None, "None", None),
        (float, "None", "None"),
        (int, 3, 3),
        (bool, True, True),
        (str, "1e-07", "1e-07"),
        (str | None, "None", "None"),
        (Floats, "[1.0, 1e-07]", [1.0, 1e-07]),
        (Floats, [1, 2], [1.0, 2.0]),
        (Floats, "[a, b]", "[a, b]"),
        (None, "1e-07", 1e-07),
    ],
)
def test_values_come_to_the_type_of_their_field(annotation, given, value):
    field = None if annotation is None else FieldInfo.from_annotation(annotation)
    found = as_given(field, given)
    assert found == value
    assert type(found) is type(value)
    assert not isinstance(found, float) or math.isfinite(found)

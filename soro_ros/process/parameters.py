"""A configuration model as ROS parameters: declared with bounds and descriptions, read back checked."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, TypeVar

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.exceptions import InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

from soro_core.config import Strict, parse
from soro_core.errors import ConfigError, SoroError
from soro_ros.host import middleware
from soro_ros.process.parameter_files import flattened, given_by_name
from soro_ros.process.parameter_values import as_given, described_field, descriptor

Model = TypeVar("Model", bound=Strict)

# Nothing of an arm is smaller, other than 0.
SMALLEST = 1e-30
# Parameters of one place, which are lists of places now, with an "s" at the end of their names.
_ONE_PLACE = ("pose_location", "imu_location", "pose.location", "imu.location")
# Parameters that rclpy declares by itself.
_OWN = ("use_sim_time", "start_type_description_service", "qos_overrides")


class NodeWithParameters(Node):
    """A node that also declares parameters with the value ``[]`` of a parameter file or the command line.

    An empty list has no type in ROS: it leaves its parameter not set, which rclpy refuses to declare.
    """

    def declare_parameters(
        self, namespace: str, parameters: list[tuple[Any, ...]], ignore_override: bool = False
    ) -> list[Parameter]:
        """Declare parameters; parameters as in `rclpy.node.Node.declare_parameters`."""
        anything = ParameterDescriptor(dynamic_typing=True)
        typed = [(p[0], None, anything) if p[1:2] == (None,) else p for p in parameters]
        return super().declare_parameters(namespace, typed, ignore_override)


def declare(node: Node, model: type[Model], take: Callable[[Model], None] = lambda config: None) -> None:
    """Declare one parameter a field of `model`, nested models with dots, and check every later change.

    The node must be a `NodeWithParameters`: what a parameter file or the command line gave beyond the
    model's fields is then seen here. It is refused, or ignored with a warning if a file gave it to many
    nodes, as in an entry ``/**``.

    Parameters
    ----------
    node : NodeWithParameters
        Owner of the parameters.
    model : type
        Their names, types, defaults and bounds.
    take : callable
        Takes over a changed configuration at once, or raises SoroError, which refuses the change.

    Raises
    ------
    ConfigError
        If what was given to this node is no field of the model.
    """
    fields, free = dict(_flatten(model)), tuple(f"{name}." for name in _mappings(model))
    for former in _ONE_PLACE:
        if f"{former}s" in fields and node.has_parameter(former):
            _take_as_list(node, former, f"{former}s")
    own, shared = given_by_name(middleware.arguments(), node.get_name()), []
    for given in node.get_parameters_by_prefix(""):
        # What is allowed in a mapping depends on other values: `read` checks it.
        if given in fields or given.startswith((*_OWN, *free)):
            continue
        if given in own:
            raise ConfigError(_where(node), given, "an unknown parameter", ", ".join(sorted(fields)))
        node.undeclare_parameter(given)
        shared.append(given)
    if shared:  # an entry for many nodes need not fit each of them
        node.get_logger().warning(
            f"not parameters of {node.get_name()}, ignored: {', '.join(sorted(shared))}"
        )
    for name, (default, field) in fields.items():
        if node.has_parameter(name):
            _describe_given(node, name, field)
        else:
            node.declare_parameter(name, default, descriptor(name, field), ignore_override=True)
    node.add_pre_set_parameters_callback(lambda changes: [_typed(fields, change) for change in changes])
    node.add_on_set_parameters_callback(lambda changes: _check(node, model, changes, take))


def _describe_given(node: Node, name: str, field: FieldInfo) -> None:
    """Describe a parameter that a file or the command line gave, and give its value the type of the field."""
    node.set_descriptor(name, ParameterDescriptor(dynamic_typing=True))
    given = node.get_parameter(name)
    if (typed := _typed({name: (None, field)}, given)) is not given:
        node.set_parameters([typed])
    found = descriptor(name, field)
    try:
        node.set_descriptor(name, found)
    except InvalidParameterValueException:  # `read` says what is allowed; ROS would not let us
        found.floating_point_range, found.integer_range = [], []
        node.set_descriptor(name, found)


def _typed(fields: Mapping[str, tuple[Any, FieldInfo]], given: Parameter) -> Parameter:
    """Return a parameter with the type of its field; one of another kind, or not set, stays as it is."""
    field = fields[given.name][1] if given.name in fields else None
    value = None if field is None else as_given(field, given.value)
    return given if value is None or value == [] else Parameter(given.name, value=value)


def _take_as_list(node: Node, former: str, name: str) -> None:
    """Read a parameter that was renamed as it became a list."""
    if node.has_parameter(name):
        raise ConfigError(_where(node), former, f"beside {name}", f"{name} alone")
    value = node.get_parameter(former).value
    node.undeclare_parameter(former)
    node.declare_parameter(name, [value], ParameterDescriptor(dynamic_typing=True), ignore_override=True)
    node.get_logger().warning(f"parameter {former} is called {name} now: [{value}]")


def read(node: Node, model: type[Model]) -> Model:
    """Return the parameters as a checked, frozen `model`; a list that is not set is the empty one.

    Raises
    ------
    ConfigError
        Naming the node, the parameter, what was found and what is allowed.
    """
    return checked(_values(node, model), model, _where(node))


def checked(values: Mapping[str, Any], model: type[Model], where: str) -> Model:
    """Return the checked, frozen `model` of values by name, ``{"a.b": value}``.

    Parameters
    ----------
    values : mapping of str to object
    model : type
    where : str
        What errors name.

    Raises
    ------
    ConfigError
        If the model does not allow a value, or one is so near to 0 that what is divided by it is infinite.
    """
    for name, value in values.items():
        for number in value if isinstance(value, Sequence) else (value,):
            if isinstance(number, float) and 0.0 < abs(number) < SMALLEST:
                raise ConfigError(where, name, number, f"0, or a number of at least {SMALLEST:g} in size")
    return parse(nested(values), model, where=where)


def described(model: type[BaseModel]) -> Iterator[tuple[str, Any, str]]:
    """Name, default and description of every parameter."""
    for name, (default, field) in _flatten(model):
        yield name, default, described_field(field)


def overrides(config: BaseModel) -> dict[str, Any]:
    """Flatten a configuration to ``{"a.b": value}``, for a parameter file or another node."""
    flat: dict[str, Any] = {}
    for name in type(config).model_fields:
        value = getattr(config, name)
        if isinstance(value, BaseModel):
            flat.update({f"{name}.{key}": inner for key, inner in overrides(value).items()})
        elif isinstance(value, Mapping):
            flat.update({f"{name}.{key}": inner for key, inner in flattened(value).items()})
        else:
            flat[name] = list(value) if isinstance(value, tuple) else value
    return flat


def _mappings(model: type[BaseModel], prefix: str = "") -> Iterator[str]:
    """Yield the names of fields that are mappings: their keys are no fields of a model."""
    for name, field in model.model_fields.items():
        default = field.get_default(call_default_factory=True)
        if isinstance(default, BaseModel):
            yield from _mappings(type(default), f"{prefix}{name}.")
        elif isinstance(default, Mapping):
            yield prefix + name


def _where(node: Node) -> str:
    return f"parameters of {node.get_name()}"


def _flatten(
    model: type[BaseModel], prefix: str = "", defaults: BaseModel | None = None
) -> Iterator[tuple[str, tuple[Any, FieldInfo]]]:
    """Yield every field with its default; that of a nested model's field comes from the outer default."""
    for name, field in model.model_fields.items():
        own = field.get_default(call_default_factory=True)
        default = own if defaults is None else getattr(defaults, name)
        if isinstance(default, BaseModel):
            yield from _flatten(type(default), f"{prefix}{name}.", default)
        elif not isinstance(default, Mapping):
            yield prefix + name, (list(default) if isinstance(default, tuple) else default, field)


def _values(node: Node, model: type[BaseModel], changes: Iterable[Parameter] = ()) -> dict[str, Any]:
    """Return the values of all parameters, with requested changes."""
    changed = {change.name: change.value for change in changes}

    def value_of(name: str) -> Any:
        # `ros2 param delete` leaves a parameter that may be not set without a declaration.
        return changed[name] if name in changed else node.get_parameter_or(name).value

    values = {}
    for name, (default, field) in _flatten(model):
        value = as_given(field, value_of(name))
        values[name] = [] if value is None and isinstance(default, list) else value
    for name in _mappings(model):
        for key in node.get_parameters_by_prefix(name):
            values[f"{name}.{key}"] = as_given(None, value_of(f"{name}.{key}"))
    return values


def nested(flat: Mapping[str, Any]) -> dict[str, Any]:
    """Return ``{"a": {"b": value}}`` of ``{"a.b": value}``; the inverse of `overrides`."""
    tree: dict[str, Any] = {}
    for name, value in flat.items():
        *parents, leaf = name.split(".")
        branch = tree
        for parent in parents:
            branch = branch.setdefault(parent, {})
        branch[leaf] = value
    return tree


def _check(
    node: Node, model: type[Model], changes: list[Parameter], take: Callable[[Model], None]
) -> SetParametersResult:
    """Refuse a change that model or node does not allow, with its reason, before it takes effect."""
    try:
        take(checked(_values(node, model, changes), model, _where(node)))
    except SoroError as error:
        return SetParametersResult(successful=False, reason=str(error))
    return SetParametersResult(successful=True)

"""A configuration model as ROS parameters: declared with bounds and descriptions, read back checked."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, TypeVar

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from soro_core.config import Strict, parse
from soro_core.errors import ConfigError
from soro_ros import middleware
from soro_ros.parameter_files import flattened, given_by_name

Model = TypeVar("Model", bound=Strict)

# What the bounds of a field are called; lengths are those of lists.
_BOUNDS = {
    "gt": "above",
    "ge": "at least",
    "lt": "below",
    "le": "at most",
    "min_length": "entries: at least",
    "max_length": "entries: at most",
}
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


def declare(node: Node, model: type[Strict]) -> None:
    """Declare one parameter a field of `model`, nested models with dots, and check every later change.

    The node must be a `NodeWithParameters`: what a parameter file or the command line gave beyond the
    model's fields is then seen here. It is refused, or ignored with a warning if a file gave it to many
    nodes, as in an entry ``/**``.

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
        # The model checks types: it accepts 200 for a float, a typed parameter does not.
        descriptor = ParameterDescriptor(description=_describe(field), dynamic_typing=True)
        if node.has_parameter(name):
            node.set_descriptor(name, descriptor)
        else:
            node.declare_parameter(name, default, descriptor, ignore_override=True)
    node.add_on_set_parameters_callback(lambda changes: _check(node, model, changes))


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
    return parse(nested(_values(node, model)), model, where=_where(node))


def described(model: type[BaseModel]) -> Iterator[tuple[str, Any, str]]:
    """Name, default and description of every parameter."""
    for name, (default, field) in _flatten(model):
        yield name, default, _describe(field)


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


def _describe(field: FieldInfo) -> str:
    """Return the description of a field with its bounds."""
    found = [
        (text, getattr(item, name))
        for item in field.metadata
        for name, text in _BOUNDS.items()
        if hasattr(item, name)
    ]
    bounds = ", ".join(f"{text} {n:g}" if isinstance(n, float) else f"{text} {n}" for text, n in found)
    return f"{field.description or ''} ({bounds})" if bounds else field.description or ""


def _values(node: Node, model: type[BaseModel], changes: Iterable[Parameter] = ()) -> dict[str, Any]:
    """Return the values of all parameters, with requested changes."""
    changed = {change.name: change.value for change in changes}
    values = {}
    for name, (default, _) in _flatten(model):
        value = changed[name] if name in changed else node.get_parameter(name).value
        if hasattr(value, "tolist") or isinstance(value, tuple):
            value = list(value)
        values[name] = [] if value is None and isinstance(default, list) else value
    for name in _mappings(model):
        for key, parameter in node.get_parameters_by_prefix(name).items():
            value = changed.get(f"{name}.{key}", parameter.value)
            values[f"{name}.{key}"] = value.tolist() if hasattr(value, "tolist") else value
    return values


def nested(flat: dict[str, Any]) -> dict[str, Any]:
    """Return ``{"a": {"b": value}}`` of ``{"a.b": value}``; the inverse of `overrides`."""
    tree: dict[str, Any] = {}
    for name, value in flat.items():
        *parents, leaf = name.split(".")
        branch = tree
        for parent in parents:
            branch = branch.setdefault(parent, {})
        branch[leaf] = value
    return tree


def _check(node: Node, model: type[Strict], changes: list[Parameter]) -> SetParametersResult:
    """Refuse a change that the model does not allow, with its reason, before it takes effect."""
    try:
        parse(nested(_values(node, model, changes)), model, where=_where(node))
    except ConfigError as error:
        return SetParametersResult(successful=False, reason=str(error))
    return SetParametersResult(successful=True)

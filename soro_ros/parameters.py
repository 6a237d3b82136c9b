"""A configuration model as ROS parameters: declared with bounds and descriptions, read back checked."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, TypeVar

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from soro_core.config import Strict, parse
from soro_core.errors import ConfigError

Model = TypeVar("Model", bound=Strict)

# Parameters that rclpy declares by itself.
_OWN = ("use_sim_time", "start_type_description_service", "qos_overrides")


def declare(node: Node, model: type[Strict]) -> None:
    """Declare one parameter a field of `model`, nested models with dots, and check every later change.

    The node must have been made with ``automatically_declare_parameters_from_overrides=True``: what a
    parameter file or the command line gave beyond the model's fields is then seen here, and refused.

    Raises
    ------
    ConfigError
        If an override is no field of the model.
    """
    fields = dict(_flatten(model))
    for given in node.get_parameters_by_prefix(""):
        if given not in fields and not given.startswith(_OWN):
            raise ConfigError(_where(node), given, "an unknown parameter", ", ".join(sorted(fields)))
    for name, (default, field) in fields.items():
        # Types are the model's business: 200 for a float is fine there, and an error in a typed parameter.
        descriptor = ParameterDescriptor(description=_describe(field), dynamic_typing=True)
        if node.has_parameter(name):
            node.set_descriptor(name, descriptor)
        else:
            node.declare_parameter(name, default, descriptor, ignore_override=True)
    node.add_on_set_parameters_callback(lambda changes: _check(node, model, changes))


def read(node: Node, model: type[Model]) -> Model:
    """Return the parameters as a checked, frozen `model`.

    Raises
    ------
    ConfigError
        Naming the node, the parameter, what was found and what is allowed.
    """
    return parse(_nested(_values(node, model)), model, where=_where(node))


def described(model: type[BaseModel]) -> Iterator[tuple[str, Any, str]]:
    """Name, default and description of every parameter."""
    for name, (default, field) in _flatten(model):
        yield name, default, _describe(field)


def overrides(config: BaseModel) -> dict[str, Any]:
    """Flatten a configuration to ``{"a.b": value}``, as a parameter file or another node wants it."""
    flat: dict[str, Any] = {}
    for name in type(config).model_fields:
        value = getattr(config, name)
        if isinstance(value, BaseModel):
            flat.update({f"{name}.{key}": inner for key, inner in overrides(value).items()})
        else:
            flat[name] = list(value) if isinstance(value, tuple) else value
    return flat


def _where(node: Node) -> str:
    return f"parameters of {node.get_name()}"


def _flatten(
    model: type[BaseModel], prefix: str = "", defaults: BaseModel | None = None
) -> Iterator[tuple[str, tuple[Any, FieldInfo]]]:
    """Every field with its default: within a nested model that of the outer one's default, `defaults`."""
    for name, field in model.model_fields.items():
        own = field.get_default(call_default_factory=True)
        default = own if defaults is None else getattr(defaults, name)
        if isinstance(default, BaseModel):
            yield from _flatten(type(default), f"{prefix}{name}.", default)
        else:
            yield prefix + name, (list(default) if isinstance(default, tuple) else default, field)


def _describe(field: FieldInfo) -> str:
    bounds = ", ".join(str(item) for item in field.metadata)
    return f"{field.description or ''} ({bounds})" if bounds else field.description or ""


def _values(node: Node, model: type[BaseModel]) -> dict[str, Any]:
    values = {}
    for name, _ in _flatten(model):
        value = node.get_parameter(name).value
        values[name] = list(value) if hasattr(value, "tolist") or isinstance(value, tuple) else value
    return values


def _nested(flat: dict[str, Any]) -> dict[str, Any]:
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
    candidate = _values(node, model)
    candidate.update({change.name: change.value for change in changes if change.name in candidate})
    try:
        parse(_nested(candidate), model, where=_where(node))
    except ConfigError as error:
        return SetParametersResult(successful=False, reason=str(error))
    return SetParametersResult(successful=True)

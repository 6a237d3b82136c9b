"""The laws by name: those shipped, and those of other packages by the entry point `soro.laws`."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any, TypeAlias

from soro_core import registered
from soro_core.control.laws.protocol import Law, LawOptions

AnyLaw: TypeAlias = type[Law[Any]]

GROUP = "soro.laws"

_HERE = "soro_core.control.laws"
# A law that needs the model's code is loaded when it is used, not when a scene is read.
SHIPPED = {
    "adaptive": f"{_HERE}.adaptive:Adaptive",
    "composite": f"{_HERE}.composite:Composite",
    "computed_torque": f"{_HERE}.computed_torque:ComputedTorque",
    "tip_pid": f"{_HERE}.tip_pid:TipPid",
}


def names() -> tuple[str, ...]:
    """Return the names of all laws: shipped ones first."""
    return registered.names_of(GROUP, SHIPPED)


def find_law(name: str) -> AnyLaw:
    """Return the law of a name.

    Raises
    ------
    ValueError
        If there is none of this name, or its package does not load; the text says what is allowed.
    """
    if name in SHIPPED:
        module, _, attribute = SHIPPED[name].partition(":")
        return getattr(import_module(module), attribute)  # type: ignore[no-any-return]
    law: AnyLaw = registered.load(GROUP, SHIPPED, name, _is_law, "subclass of soro_core.control.laws.Law")
    return law


def _is_law(found: Any) -> bool:
    return isinstance(found, type) and issubclass(found, Law)


def options_of(name: str, values: Mapping[str, Any]) -> LawOptions:
    """Return the checked options of a law.

    Raises
    ------
    pydantic.ValidationError
        If a key or a value is not allowed.
    ValueError
        As `find_law`.
    """
    return find_law(name).Options.model_validate(dict(values))

"""The laws: shipped ones, those of packages by the entry point `soro.laws`, FILE.py:CLASS, and classes."""

from __future__ import annotations

import hashlib
import inspect
import re
import sys
from collections.abc import Mapping
from functools import lru_cache
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any, TypeAlias

from soro_core import registered
from soro_core.control.laws.protocol import Law, LawOptions
from soro_core.errors import nearest

AnyLaw: TypeAlias = type[Law[Any]]

GROUP = "soro.laws"
_ONE = "subclass of soro_core.control.laws.Law with initial_state, step and Options of LawOptions"
# Classes that a program has given, by their names.
_GIVEN: dict[str, AnyLaw] = {}
_IN_FILE = re.compile(r"(.+\.py):(\w+)")

_HERE = "soro_core.control.laws"
# A law that needs the model's code is loaded when it is used, not when a scene is read.
SHIPPED = {
    "adaptive": f"{_HERE}.adaptive:Adaptive",
    "composite": f"{_HERE}.composite:Composite",
    "counterbalance": f"{_HERE}.counterbalance:CounterbalanceLaw",
    "computed_torque": f"{_HERE}.computed_torque:ComputedTorque",
    "tip_pid": f"{_HERE}.tip_pid:TipPid",
    "wrap": f"{_HERE}.wrap:Wrap",
}


def names() -> tuple[str, ...]:
    """Return the names of all laws: shipped ones first."""
    return registered.names_of(GROUP, SHIPPED)


def named(law: type) -> str:
    """Return the name by which `find_law` gives a class in this process.

    Raises
    ------
    ValueError
        If the class is no law.
    """
    if not _is_law(law):
        raise ValueError(f"{_allowed()}, or a class that is a {_ONE}")
    _GIVEN[name := f"{law.__module__}:{law.__qualname__}"] = law
    return name


def find_law(name: str) -> AnyLaw:
    """Return the law of a name, or of FILE.py:CLASS, whose code is run.

    Raises
    ------
    ValueError
        If there is none of this name, or its package or file does not load; the text says what is allowed.
    """
    if name in SHIPPED:
        module, _, attribute = SHIPPED[name].partition(":")
        return getattr(import_module(module), attribute)  # type: ignore[no-any-return]
    if name in _GIVEN:
        return _GIVEN[name]
    if place := _IN_FILE.fullmatch(name):
        return _law_of_file(Path(place[1]), place[2])
    if name not in names():
        raise ValueError(_allowed() + nearest(name, names()))
    law: AnyLaw = registered.load(GROUP, SHIPPED, name, _is_law, _ONE)
    return law


def with_folder(name: str, folder: Path) -> str:
    """Return FILE.py:CLASS with the file in a folder, if it is there; any other name as it is."""
    place = _IN_FILE.fullmatch(name)
    if place is None or not (file := folder / place[1]).is_file():
        return name
    return f"{file.absolute()}:{place[2]}"


def _allowed() -> str:
    return f"one of {', '.join(names())}, or FILE.py:CLASS"


def _law_of_file(file: Path, name: str) -> AnyLaw:
    file = file.absolute()
    if not file.is_file():
        raise ValueError(f"{_allowed()}; there is no file {file}")
    law: Any
    try:
        law = getattr(_module_of(file, file.stat().st_mtime_ns), name, None)
    except (Exception, SystemExit) as error:  # whatever a file does when it is run
        raise ValueError(
            f"{_allowed()}; {file} does not load ({registered.told(error, str(file))})"
        ) from None
    if not _is_law(law):
        raise ValueError(f"{_allowed()}; {name} of {file} is no {_ONE}")
    return law  # type: ignore[no-any-return]


@lru_cache(maxsize=16)
def _module_of(file: Path, changed_ns: int) -> ModuleType:
    """Run a file once, and again after a change; its name finds the module again, for pickled states."""
    digest = hashlib.sha256(f"{file} {changed_ns}".encode()).hexdigest()[:16]
    spec = spec_from_file_location(f"soro_law_{digest}", file)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[spec.name] = module_from_spec(spec)  # dataclasses look their module up there
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[spec.name]
        raise
    return module


def _is_law(found: Any) -> bool:
    if not (isinstance(found, type) and issubclass(found, Law)) or inspect.isabstract(found):
        return False
    return isinstance(found.Options, type) and issubclass(found.Options, LawOptions)


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

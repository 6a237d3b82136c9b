"""The public names of the library, package by package."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from inspect import ismodule
from pathlib import Path
from typing import Any

import soro_core
import soro_design
import soro_hardware
import soro_lab
from reference import fields

_PACKAGE = """## {name}

{about}

```{{eval-rst}}
{names}
```
"""


def pages() -> dict[str, tuple[str, str, str]]:
    """Return the page of the library."""
    body = "\n".join(_section(module, names) for module, names in public())
    return {"api": ("The library", "Public classes and functions; none of them needs ROS.", body)}


def public() -> Iterator[tuple[Any, dict[str, object]]]:
    """Yield each package with the names that no package before it has."""
    seen: set[int] = set()
    for package in (soro_core, soro_hardware, soro_lab, soro_design):
        for module in map(import_module, _packages(package)):
            if things := _exported(module):
                yield module, {name: thing for name, thing in things.items() if id(thing) not in seen}
                seen |= set(map(id, things.values()))


def escape(app: object, what: str, name: str, thing: object, options: object, lines: list[str]) -> None:
    """Keep the bars of absolute values in docstrings; parameters as in `autodoc-process-docstring`."""
    lines[:] = [line.replace("|", r"\|") for line in lines]


def show_fields(
    linked: list[type], app: object, what: str, name: str, thing: object, options: object, lines: list[str]
) -> None:
    """Show the fields of a class; parameters as in `fields.show` and `autodoc-process-docstring`."""
    fields.show(linked, what, thing, lines)


def skip(app: object, what: str, name: str, thing: object, skipped: bool, options: object) -> bool | None:
    """Leave out what says nothing; parameters as in `autodoc-skip-member`."""
    return True if fields.is_alias(what, thing) else None


def _packages(package: Any) -> list[str]:
    """Return the names of a package and of those below it."""
    root = Path(package.__file__).parent
    below = sorted(path.parent for path in root.rglob("__init__.py") if path.parent != root)
    return [".".join((package.__name__, *folder.relative_to(root).parts)) for folder in (root, *below)]


def _exported(module: Any) -> dict[str, Any]:
    """Return what a package exports: by its list, or else what its file imports."""
    imported = (name for name, thing in vars(module).items() if name[0] != "_" and not ismodule(thing))
    return {name: getattr(module, name) for name in getattr(module, "__all__", sorted(imported))}


def _section(module: Any, things: dict[str, object]) -> str:
    names = "\n".join(f".. {_directive(thing)}:: {module.__name__}.{name}" for name, thing in things.items())
    return _PACKAGE.format(name=module.__name__, about=module.__doc__, names=names)


def _directive(thing: object) -> str:
    return "autoclass" if isinstance(thing, type) else "autofunction" if callable(thing) else "autodata"

"""The public names of the library, package by package."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

import soro_core
import soro_design
import soro_hardware
import soro_lab

_PACKAGE = """## {name}

{about}

```{{eval-rst}}
{names}
```
"""


def pages() -> dict[str, tuple[str, str, str]]:
    """Return the page of the library."""
    names = [
        name for package in (soro_core, soro_hardware, soro_lab, soro_design) for name in _packages(package)
    ]
    modules = [module for module in map(import_module, names) if hasattr(module, "__all__")]
    seen: set[int] = set()
    body = "\n".join(_section(module, seen) for module in modules)
    return {"api": ("The library", "Public classes and functions; none of them needs ROS.", body)}


def escape(app: object, what: str, name: str, thing: object, options: object, lines: list[str]) -> None:
    """Keep the bars of absolute values in docstrings; parameters as in `autodoc-process-docstring`."""
    lines[:] = [line.replace("|", r"\|") for line in lines]


def _packages(package: Any) -> list[str]:
    """Return the names of a package and of those below it."""
    root = Path(package.__file__).parent
    below = sorted(path.parent for path in root.rglob("__init__.py") if path.parent != root)
    return [".".join((package.__name__, *folder.relative_to(root).parts)) for folder in (root, *below)]


def _section(module: Any, seen: set[int]) -> str:
    """Return the names of a package that no package before it has."""
    things = {name: getattr(module, name) for name in module.__all__}
    new = {name: thing for name, thing in things.items() if id(thing) not in seen}
    seen |= {id(thing) for thing in new.values()}
    names = "\n".join(f".. {_directive(thing)}:: {module.__name__}.{name}" for name, thing in new.items())
    return _PACKAGE.format(name=module.__name__, about=module.__doc__, names=names)


def _directive(thing: object) -> str:
    return "autoclass" if isinstance(thing, type) else "autofunction" if callable(thing) else "autodata"

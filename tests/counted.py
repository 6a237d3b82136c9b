"""How often the controller section of a scene is checked, and which YAML files are read."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from soro_core import config
from soro_core.control.config import ControllerConfig

_RULE = ControllerConfig.__pydantic_decorators__.model_validators["_of_one_law"].func.__code__


@dataclass
class Counted:
    """Names of the files in the order in which they were read; checks of the whole section."""

    files: list[str] = field(default_factory=list)
    checks: int = 0


@contextmanager
def counted() -> Iterator[Counted]:
    found, read, before = Counted(), config.read_value, sys.getprofile()

    def noted(text: str, where: str) -> object:
        found.files.append(Path(where).name)
        return read(text, where)

    def profiled(frame, event, _) -> None:
        found.checks += event == "call" and frame.f_code is _RULE

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(config, "read_value", noted)
        sys.setprofile(profiled)
        try:
            yield found
        finally:
            sys.setprofile(before)

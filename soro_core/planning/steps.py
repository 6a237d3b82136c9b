"""Work in steps, which a node continues between its ticks."""

from __future__ import annotations

from collections.abc import Generator
from typing import TypeAlias, TypeVar

Result = TypeVar("Result")
Planning: TypeAlias = Generator[None, None, Result]
"""Work that returns a result, and yields None after each step."""


def finished(steps: Planning[Result]) -> Result:
    """Return the result of all steps."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value  # type: ignore[no-any-return]

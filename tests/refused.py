"""What an error names, in place of how it says it."""

import contextlib
import re
from collections.abc import Iterator
from typing import Any
from unittest.mock import ANY

import pytest

from soro_core.errors import BAG_CODES, HARDWARE_CODES, ConfigError, SoroError
from soro_hardware.port import FAULT_CODES

CODES = {"", *HARDWARE_CODES, *BAG_CODES, *FAULT_CODES}


@contextlib.contextmanager
def refused(
    key: str, got: Any = ANY, names: tuple[str, ...] = ()
) -> Iterator[pytest.ExceptionInfo[ConfigError]]:
    """Expect a ConfigError of a key, whatever its words.

    Parameters
    ----------
    key : str
        Dotted path; empty for a whole file or mapping.
    got : object
        What was found, where that matters.
    names : tuple of str
        Names of keys, files or values that stand in what is allowed.
    """
    with pytest.raises(ConfigError) as caught:
        yield caught
    error = caught.value
    assert error.key == key, error
    assert error.got == got, error
    assert all(name in error.allowed for name in names), error
    assert "\n" not in str(error)


@contextlib.contextmanager
def fails(kind: type[SoroError], *names: str, **facts: object) -> Iterator[pytest.ExceptionInfo[Any]]:
    """Expect an error by its structure, whatever its words.

    Parameters
    ----------
    kind : type
        Of the error.
    names : str
        Names and values that a user must find in the line.
    facts : object
        Values of attributes of the error, for example ``code="gone"``.
    """
    with pytest.raises(kind) as caught:
        yield caught
    error = caught.value
    assert {fact: getattr(error, fact) for fact in facts} == facts, error
    assert getattr(error, "code", "") in CODES
    said = str(error).removeprefix(getattr(error, "where", ""))  # a path may hold any number
    assert all(name in said for name in names), error
    assert all(str(value) in str(error) for fact, value in facts.items() if fact != "code"), error
    assert "\n" not in str(error)


_REFUSAL = re.compile(r"([^\s:]+): (?:got .*?; )?allowed: ")


def refused_keys(text: str) -> list[str]:
    """Keys of the refusals in the output of a process; where a whole file is refused, its path."""
    return _REFUSAL.findall(text)


def tripped(cause: str | None) -> tuple[str, str]:
    """Code of what has latched a limiter, and the chamber or device that it names."""
    assert cause is not None
    code, _, rest = cause.partition(": ")
    return code, rest.split()[0].rstrip(":;,")

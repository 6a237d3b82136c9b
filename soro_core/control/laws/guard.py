"""An error of a law from outside names the law, its file and the line."""

from __future__ import annotations

import contextlib
import inspect
from collections.abc import Callable, Iterator
from functools import wraps
from typing import Any

from soro_core.errors import ConfigError, ModelError
from soro_core.registered import told


class LawError(ModelError):
    """A law has raised an error, or returned what no law may return; the controller holds its set points.

    Parameters
    ----------
    law : str
        Name of the law.
    text : str
        What happened; the message is ``law NAME: text``.
    """

    def __init__(self, law: str, text: str) -> None:
        self.law, self.text = law, text
        super().__init__(f"law {law}: {text}", "law")


@contextlib.contextmanager
def refused() -> Iterator[None]:
    """Make the error of a law a refusal, as long as nothing has moved: ConfigError with the key `law`."""
    try:
        yield
    except LawError as error:
        raise ConfigError("controller", "law", error.law, f"a law that runs: {error.text}") from error


def guard(law: type[Any], methods: frozenset[str]) -> None:
    """Make the methods of a class that have one of these names raise nothing but LawError and ConfigError."""
    for name in methods & vars(law).keys():
        if inspect.isfunction(method := vars(law)[name]):
            setattr(law, name, _guarded(method))


def _guarded(method: Callable[..., Any]) -> Callable[..., Any]:
    @wraps(method)
    def call(law: Any, *given: Any, **named: Any) -> Any:
        try:
            return method(law, *given, **named)
        except (LawError, ConfigError):  # named already; a refusal has its own text
            raise
        except (Exception, SystemExit) as error:  # whatever a law from outside does must not end the loop
            raise LawError(_name(law), told(error, method.__module__)) from error

    return call


def _name(law: Any) -> str:
    """Return the name by which a law was asked for."""
    setting = getattr(law, "setting", None)
    return setting.config.law if setting is not None else type(law).__name__

"""Check of the security that the environment asks for; ROS itself would continue without it, unreported."""

from __future__ import annotations

import os
import tempfile
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import rclpy
from rclpy.context import Context
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.impl.logging_severity import LoggingSeverity
from rclpy.logging import get_logger_level, set_logger_level
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import get_rmw_implementation_identifier

from soro_core.errors import ConfigError

_ENABLE = "ROS_SECURITY_ENABLE"


def check() -> None:
    """Refuse ROS_SECURITY_ENABLE=true (no other value enables it) with a middleware without security.

    Raises
    ------
    ConfigError
        One line with the error of the middleware.
    """
    if os.environ.get(_ENABLE) == "true" and (reason := _missing()):
        allowed = f"false, or none, with {get_rmw_implementation_identifier()} as it is here: {reason}"
        raise ConfigError("environment", _ENABLE, "true", allowed)


def _missing() -> str | None:
    """Return the error of the middleware for an empty keystore; None if it accepts it and has security."""
    context, level = Context(), get_logger_level("rcl")
    with tempfile.TemporaryDirectory() as keystore, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        (Path(keystore) / "enclaves").mkdir()
        set_logger_level("rcl", LoggingSeverity.WARN)
        try:
            with _environment(ROS_SECURITY_KEYSTORE=keystore, ROS_SECURITY_STRATEGY="Permissive"):
                rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
                plain = Node("security", context=context, enable_rosout=False, start_parameter_services=False)
                plain.destroy_node()
        except rclpy_implementation.RCLError as error:
            return str(error).removeprefix("error creating node: ").splitlines()[0]
        finally:
            context.try_shutdown()
            set_logger_level("rcl", level)
    return None


@contextmanager
def _environment(**variables: str) -> Iterator[None]:
    before: Mapping[str, str | None] = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value

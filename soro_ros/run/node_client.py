"""What a program asks a running node for: its parameters, its services, and whether it is vented."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Container, Iterator, Mapping
from typing import Any

from rcl_interfaces.msg import Parameter as Message
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.parameter import Parameter

from soro_core.errors import ConfigError
from soro_ros.host.services import ServiceCaller
from soro_ros.topics.motion_job import REFUSED

# Period of a wait [s].
POLL_S = 0.02


class NodeClient:
    """Asks one node.

    Parameters
    ----------
    caller : ServiceCaller
    node : str
        Full name of the node.
    limit_s : float
        Longest wait for an answer or a report [s].
    say : callable
        Takes a line of progress.

    Attributes
    ----------
    ended : str
        How the last request has ended, as the node has said; empty if it has not.
    """

    def __init__(self, caller: ServiceCaller, node: str, limit_s: float, say: Callable[[str], None]) -> None:
        self._caller, self._node = caller, node
        self._limit_s, self._say = limit_s, say
        self._namespace, self.ended = node.rpartition("/")[0], ""

    @contextlib.contextmanager
    def configured(
        self, given: Mapping[str, float | bool | None], once: Container[str] = ()
    ) -> Iterator[None]:
        """Set parameters for what is asked; those of a refused request are taken back.

        Parameters
        ----------
        given : mapping
            Values by name; None leaves one as it is.
        once : container of str
            Names of those that are taken back in any case.

        Raises
        ------
        ConfigError
            If the node refuses one; it then takes none.
        """
        wanted = {key: Parameter(key, value=value) for key, value in given.items() if value is not None}
        if not wanted:
            yield
            return
        request = GetParameters.Request(names=list(wanted))
        before = self._call("get_parameters", GetParameters, request).values
        self._set([value.to_parameter_msg() for value in wanted.values()])
        try:
            yield
        finally:
            olds = zip(wanted, before, strict=True)
            back = [(key, old) for key, old in olds if key in once or self.ended == REFUSED]
            self._set([Message(name=key, value=old) for key, old in back])

    def _set(self, parameters: list[Message]) -> None:
        if not parameters:
            return
        request = SetParametersAtomically.Request(parameters=parameters)
        result = self._call("set_parameters_atomically", SetParametersAtomically, request).result
        if not result.successful:
            keys = ", ".join(parameter.name for parameter in parameters)
            values = ", ".join(str(Parameter.from_parameter_msg(one).value) for one in parameters)
            raise ConfigError(self._node, keys, values, result.reason)

    def _call(self, service: str, kind: Any, request: Any) -> Any:
        return self._caller.call(self._node, service, kind, request, self._limit_s)

    def _wait(self, ready: Callable[[], bool]) -> bool:
        deadline = time.monotonic() + self._limit_s
        while not ready() and time.monotonic() < deadline:
            self._caller.spin(POLL_S)
        return ready()

    def _vented(self) -> str:
        """Why the arm of the controller is vented; empty if it is not."""
        for name, status in self._caller.status.items():
            is_of_arm = name.rpartition("/")[0] == self._namespace
            if is_of_arm and status.message.startswith("vented"):
                return f"{name}: {status.message}"
        return ""

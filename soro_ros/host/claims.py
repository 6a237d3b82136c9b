"""Names of a ROS domain that one program of this host has at a time: an arm, its nodes, who publishes for it.

ROS lets two programs use one name: their nodes then answer each other, and command one arm. A name is claimed
by an abstract Unix socket. As the loopback interface, over which soro's nodes find each other (ADR 0015), it
exists once in a network namespace; the kernel frees it when its process ends, however it ends.
"""

from __future__ import annotations

import errno
import hashlib
import socket
import struct
from collections.abc import Iterable

from rclpy.node import Node

from soro_core.errors import ConfigError
from soro_ros.host import services

# Newcomers that are told which process has a name; later ones are refused without its number.
_ASKING = 128
_ALLOWED = "one at a time: end that one, or use another ROS_DOMAIN_ID or namespace"


class Claims:
    """The names that this process has; a context manager that gives them back."""

    def __init__(self) -> None:
        self._sockets: list[socket.socket] = []

    def __enter__(self) -> Claims:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def take(self, node: Node, names: Iterable[str]) -> None:
        """Claim names in the domain of a node.

        Raises
        ------
        ConfigError
            If another program has one of them.
        """
        for name in names:
            claim = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            self._sockets.append(claim)
            try:
                claim.bind(_address(node, name))
            except OSError as error:
                if error.errno != errno.EADDRINUSE:
                    raise
                raise taken(node, name, _process(node, name) or "another program") from None
            claim.listen(_ASKING)

    def close(self) -> None:
        """Give all names back."""
        while self._sockets:
            self._sockets.pop().close()


def require_free(node: Node, names: Iterable[str]) -> None:
    """Raise ConfigError if a program has one of these names in the domain of a node."""
    for name in names:
        if (found := _process(node, name)) is not None:
            raise taken(node, name, found)


def taken(node: Node, name: str, by: str) -> ConfigError:
    """Return the error for a name that a program has.

    Parameters
    ----------
    node : Node
        Node of the domain.
    name : str
    by : str
        Which program has it.
    """
    return ConfigError(services.domain(node), name, f"{by} has it", _ALLOWED)


def of_arm(namespace: str) -> str:
    """Return the name that a run of an arm claims, which is no name of ROS."""
    return f"run of /{namespace}"


def readings(namespace: str) -> str:
    """Return the topic whose publisher drives the valves of an arm."""
    return f"{namespace.rstrip('/')}/chambers/state"


def _address(node: Node, name: str) -> bytes:
    domain = node.context.get_domain_id()
    return b"\0soro-" + hashlib.sha256(f"{domain} {name}".encode()).hexdigest().encode()


def _process(node: Node, name: str) -> str | None:
    """Return the process that has a name; None if it is free."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as asking:
        asking.setblocking(False)
        try:
            asking.connect(_address(node, name))
        except BlockingIOError:  # too many have asked
            return "another process"
        except OSError:
            return None
        size = struct.calcsize("3i")
        pid, _, _ = struct.unpack("3i", asking.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, size))
    return f"process {pid}" if pid else "a process of another container"

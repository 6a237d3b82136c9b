"""The host of a TCP server that has one host at a time."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Callable

_DRAIN = 16  # chunks of the present host that are read before a new host is accepted or refused


def accept_host(
    listener: socket.socket, read: Callable[[], bool], refuse: Callable[[str], bytes | None]
) -> socket.socket | None:
    """Accept a new host; return its socket, or None for no host or a refused one.

    Parameters
    ----------
    listener : socket
        Listening socket, not blocking.
    read : callable
        Processes received bytes of the present host; returns whether there may be more.
    refuse : callable
        Returns None to accept a host at an IP address, or the bytes sent to a refused one.
    """
    try:
        host, (address, *_) = listener.accept()
    except BlockingIOError:
        return None
    host.setblocking(False)
    # Read the end of the last connection first, so that it does not cause a refusal of the next one.
    for _ in range(_DRAIN):
        if not read():
            break
    if (refusal := refuse(address)) is None:
        host.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return host
    with contextlib.suppress(OSError):
        host.send(refusal)
    host.close()
    return None

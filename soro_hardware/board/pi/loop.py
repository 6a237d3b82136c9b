"""The loop of `soro board`: one host at a time over TCP, and the board's own clock."""

from __future__ import annotations

import selectors
import socket
from collections.abc import Callable

from soro_hardware.board.pi.board import Board
from soro_hardware.transport.host import accept_host

_CHUNK = 65536
_BACKLOG = 16384  # bytes kept for a host that does not read; further frames are dropped


class Server:
    """Event loop of sockets and board.

    Parameters
    ----------
    board : Board
        Board to serve.
    listener : socket
        Listening socket.
    clock : callable
        Returns a monotonic time [ns].
    beat : callable
        Called in every turn of the loop, at least once in each refresh period of the ports.
    """

    def __init__(
        self,
        board: Board,
        listener: socket.socket,
        clock: Callable[[], int],
        beat: Callable[[], None],
    ) -> None:
        self._board, self._listener, self._clock, self._beat = board, listener, clock, beat
        self._host: socket.socket | None = None
        self._output = bytearray()
        self._stopped = False
        # select() waits with a resolution of 1 us; epoll and poll round up to 1 ms.
        self._selector = selectors.SelectSelector()
        listener.setblocking(False)
        self._selector.register(listener, selectors.EVENT_READ, self._accept)

    def run(self) -> None:
        """Serve until `stop`; at the end, also after an error, the ports are at 0 Pa."""
        try:
            while not self._stopped:
                self._beat()
                self._put(self._board.poll(self._clock()))
                timeout_s = (self._board.next_event_ns - self._clock()) * 1e-9
                for key, _ in self._selector.select(max(timeout_s, 0.0)):
                    key.data()
        finally:
            self._put(self._board.stop(self._clock()))
            self._drop()
            self._selector.close()

    def wake_on(self, descriptor: int) -> None:
        """Make `run` check for `stop` when a descriptor becomes readable."""
        self._selector.register(descriptor, selectors.EVENT_READ, lambda: None)

    def stop(self) -> None:
        """End `run` after the present turn; may be called from a signal handler."""
        self._stopped = True

    def _accept(self) -> None:
        board, clock = self._board, self._clock
        host = accept_host(self._listener, self._read, lambda address: board.refuse_host(address, clock()))
        if host is not None:
            self._leave()
            self._host = host
            board.host_came(clock())
            self._selector.register(host, selectors.EVENT_READ, self._read)

    def _read(self) -> bool:
        """Process received bytes; return whether there may be more."""
        if self._host is None:
            return False
        try:
            chunk = self._host.recv(_CHUNK)
        except BlockingIOError:
            return False
        except OSError:
            chunk = b""
        if not chunk:
            self._leave()
            return False
        if answer := self._board.feed(chunk, self._clock()):
            self._put(answer)
        if self._board.hang_up:
            self._leave()
            return False
        return True

    def _put(self, data: bytes) -> None:
        if self._host is None:
            return
        if len(self._output) + len(data) <= _BACKLOG:
            self._output += data
        if not self._output:
            return
        try:
            del self._output[: self._host.send(self._output)]
        except BlockingIOError:
            pass
        except OSError:
            self._leave()

    def _leave(self) -> None:
        """Process that the host has disconnected."""
        if self._host is not None:
            self._drop()
            self._board.host_gone(self._clock())

    def _drop(self) -> None:
        host, self._host = self._host, None
        self._output.clear()
        if host is not None:
            self._selector.unregister(host)
            host.close()

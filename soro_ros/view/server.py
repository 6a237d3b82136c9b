"""The web server of the view: viser behind the checks of `Access`."""

from __future__ import annotations

import contextlib
import io
import logging
from collections.abc import Awaitable, Callable, Iterator
from contextvars import ContextVar
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any

import msgspec.msgpack
import viser
import websockets.asyncio.server
from websockets.datastructures import Headers
from websockets.http11 import Response

from soro_core.errors import SoroError
from soro_ros.view.access import HEADERS, HOST, Access, Answer

# What a browser without the token may send: where it looks from.
_LOOKING = "ViewerCameraMessage"
NO_PAGE = Answer(HTTPStatus.NOT_FOUND, "the view has no such page")
ONLOOKER = "You may only look: open the address with the token, from the terminal of the view."

Handler = Callable[[Any], Awaitable[None]]


@dataclass
class _Onlooker:
    """A connection without the token: of what it sends, only its camera arrives."""

    connection: Any
    client: viser.ClientHandle | None = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self.connection, name)

    async def recv(self) -> bytes:
        while True:
            data = await self.connection.recv()
            if isinstance(data, bytes) and msgspec.msgpack.decode(data).get("type") == _LOOKING:
                return data
            if self.client is not None:
                self.client.add_notification("Refused", ONLOOKER, color="red", auto_close_seconds=6.0)


_onlooker: ContextVar[_Onlooker | None] = ContextVar("onlooker", default=None)


class ViewServer(viser.ViserServer):
    """A viser server on this host, at a port or the next free one.

    Parameters
    ----------
    access : Access
        Decides on each request.
    port : int

    Raises
    ------
    SoroError
        If this release of viser does not let its requests be checked.
    """

    def __init__(self, access: Access, port: int) -> None:
        guard = _Guard(access)
        with (
            guard.in_place(),
            contextlib.redirect_stdout(io.StringIO()),
        ):  # viser prints an address of its own
            super().__init__(host=HOST, port=port, label="soro", verbose=False)
        if not guard.used:
            self.stop()
            raise SoroError(f"viser {viser.__version__} is too new: its requests cannot be checked")
        self.on_client_connect(_introduce)
        self.gui.configure_theme(show_logo=False, show_share_button=False)

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refuse: viser would forward this port to a public server."""
        return None

    def stop(self) -> None:
        """End the server."""
        with contextlib.redirect_stdout(io.StringIO()):
            super().stop()


async def _introduce(client: viser.ClientHandle) -> None:
    if (onlooker := _onlooker.get()) is not None:
        onlooker.client = client
        client.add_notification("Without buttons", ONLOOKER, color="orange")


class _Guard:
    """Puts the checks before the requests and the web sockets of a server that viser starts."""

    def __init__(self, access: Access) -> None:
        self._access, self.used = access, False

    @contextlib.contextmanager
    def in_place(self) -> Iterator[None]:
        """Let a server that starts meanwhile be guarded."""
        module, serve = websockets.asyncio.server, websockets.asyncio.server.serve

        def guarded(handler: Handler, *args: Any, process_request: Any, **options: Any) -> Any:
            self.used = True
            request = self._checked(process_request)
            # A browser opens spare connections and closes them unused: no error that a user should read.
            silent = logging.getLogger("soro_ros.view.connections")
            silent.setLevel(logging.CRITICAL + 1)
            return serve(self._watched(handler), *args, process_request=request, logger=silent, **options)

        module.serve = guarded  # type: ignore[misc, assignment]
        try:
            yield
        finally:
            module.serve = serve  # type: ignore[misc]

    def _checked(self, process_request: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
        def check(connection: Any, request: Any) -> Response | None:
            answer = self._access.answer(request.path, request.headers, _port(connection))
            response = _page(process_request, connection, request) if answer is None else _response(answer)
            if response is not None:
                for name, value in HEADERS.items():
                    response.headers[name] = value
            return response

        return check

    def _watched(self, handler: Handler) -> Handler:
        async def watch(connection: Any) -> None:
            if self._access.may_press(connection.request.headers, _port(connection)):
                await handler(connection)
                return
            onlooker = _Onlooker(connection)
            _onlooker.set(onlooker)
            await handler(onlooker)

        return watch


def _page(process_request: Callable[[Any, Any], Any], connection: Any, request: Any) -> Response | None:
    """Return the page that viser has for a request, or a line that there is none."""
    try:
        found: Response | None = process_request(connection, request)
    except OSError:  # a path that cannot be that of a file
        return _response(NO_PAGE)
    return _response(NO_PAGE) if found is not None and found.status_code == HTTPStatus.NOT_FOUND else found


def _port(connection: Any) -> int:
    return int(connection.local_address[1])


def _response(answer: Answer) -> Response:
    body = f"{answer.text}\n".encode()
    given = {
        "Content-Type": "text/plain; charset=utf-8",
        "Content-Length": str(len(body)),
        "Connection": "close",
    }
    return Response(answer.status, answer.status.phrase, Headers({**given, **answer.headers}), body)

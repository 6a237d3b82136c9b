"""Who may look at the view, and who may press its buttons.

The view listens on this host alone, but every page in the browser, and every program of this host, can reach
it there. So a page is answered only under the view's own address, and a web socket only from the view's own
page; and only a browser that has opened the address with the token may do more than look (docs/view.md).
"""

from __future__ import annotations

import re
import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field
from http import HTTPStatus
from urllib.parse import parse_qs, urlsplit

HOST = "127.0.0.1"
# Headers that a browser sends once; of several, this server and the browser could believe different ones.
_ONCE = ("Host", "Origin", "Upgrade", "Cookie", "Accept-Encoding")
_PATH = re.compile(r"/(?!/)[!-~]*")

# For every answer: no other page may frame this one, and it may fetch nothing from elsewhere.
HEADERS = {
    "X-Frame-Options": "DENY",
    "Content-Security-Policy": "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; "
    "frame-ancestors 'none'; form-action 'none'; base-uri 'none'",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}


@dataclass(frozen=True)
class Answer:
    """An answer to a request that does not reach the page."""

    status: HTTPStatus
    text: str
    headers: Mapping[str, str] = field(default_factory=dict)


class Access:
    """Checks each request to the view.

    Parameters
    ----------
    token : str
        What the one who may press must know; a new random one by default.
    """

    def __init__(self, token: str = "") -> None:
        self._token = token or secrets.token_urlsafe(24)

    def address(self, port: int) -> str:
        """Return the address that gives a browser the buttons."""
        return f"http://{HOST}:{port}/?token={self._token}"

    def answer(self, path: str, headers: Mapping[str, str], port: int) -> Answer | None:
        """Refuse a request, or give its browser the token; None: the page, or its web socket, may follow.

        Parameters
        ----------
        path : str
            Path of the request, with what follows ``?``.
        headers : mapping of str to str
            Headers of the request; names in any case. `get` raises LookupError for one that is there twice.
        port : int
            Port of the view.
        """
        if (malformed := _malformed(path, headers)) is not None:
            return Answer(HTTPStatus.BAD_REQUEST, malformed)
        host = headers.get("Host", "")
        if host not in (f"{HOST}:{port}", f"localhost:{port}"):
            return Answer(HTTPStatus.FORBIDDEN, f"the view is at http://{HOST}:{port}/ alone")
        origin = headers.get("Origin")
        if (origin is not None or "Upgrade" in headers) and origin != f"http://{host}":
            return Answer(HTTPStatus.FORBIDDEN, "the view talks to its own page alone")
        given = parse_qs(urlsplit(path).query).get("token")
        if given is None:
            return None
        if not self._is_token(given[0]):
            return Answer(
                HTTPStatus.FORBIDDEN, "this token is not that of the running view: see its terminal"
            )
        # The cookie takes the place of the token, which then stands in no address bar and no history.
        cookie = f"{_cookie(port)}={self._token}; Path=/; HttpOnly; SameSite=Strict"
        return Answer(HTTPStatus.SEE_OTHER, "", {"Location": "/", "Set-Cookie": cookie})

    def may_press(self, headers: Mapping[str, str], port: int) -> bool:
        """Return whether a request comes from a browser that has been given the token."""
        pairs = (part.strip().partition("=") for part in headers.get("Cookie", "").split(";"))
        return any(self._is_token(value) for name, _, value in pairs if name == _cookie(port))

    def _is_token(self, given: str) -> bool:
        return secrets.compare_digest(given.encode(errors="surrogateescape"), self._token.encode())


def _malformed(path: str, headers: Mapping[str, str]) -> str | None:
    """Return why a request cannot be answered; None if it can."""
    page = path.partition("?")[0]
    if _PATH.fullmatch(page) is None or "%00" in page:
        return "the path of the request is none of a page: it begins with one / and is of plain letters"
    for name in _ONCE:
        try:
            headers.get(name)
        except LookupError:
            return f"the request has more than one header {name}"
    return None


def _cookie(port: int) -> str:
    """Cookies know no ports: two views on one host need two names, and each server on it gets both."""
    return f"soro_view_{port}"

"""Texts for errors of ports, connections and paths: one line, with advice."""

from __future__ import annotations

import errno
import os

IN_USE = "in use by another program"

_LOOK, _AGAIN = "check its cable and supply", "start the other side again"
_DO = {
    errno.ENOENT: "plug it in or start what makes it, or correct the path",
    errno.EACCES: "`soro doctor` says how to get the right to it",
    errno.ENOTTY: "it is no serial port, so correct the path",
    errno.EIO: _LOOK,
    errno.ENXIO: _LOOK,
    errno.ENODEV: _LOOK,
    errno.ECONNREFUSED: "start what serves it, or correct the address",
    errno.ECONNRESET: _AGAIN,
    errno.EPIPE: _AGAIN,
    errno.ETIMEDOUT: f"{_LOOK}, and the address",
    errno.EHOSTUNREACH: f"{_LOOK}, and the address",
    errno.ENETUNREACH: f"{_LOOK}, and the address",
}


def reason(error: BaseException) -> str:
    """Return the reason of a failed call, or of the library error that wraps it: one line, no error number.

    Libraries wrap errors of the system and repeat their text.
    """
    number = _number(error) or (_number(error.__context__) if error.__context__ else None)
    if number is None:
        return getattr(error, "strerror", None) or str(error)
    if number == errno.EAGAIN:  # of a lock
        return f"{IN_USE}; end that program"
    advice = _DO.get(number)
    return f"{os.strerror(number)}; {advice}" if advice else os.strerror(number)


def no_socket(error: OSError) -> str:
    """Return the reason why a Unix socket cannot be made; the caller has removed an old socket before."""
    return "a file of that name is in the way" if error.errno == errno.EADDRINUSE else reason(error)


def _number(error: BaseException) -> int | None:
    """Return the error number of the system, which is the first argument of many errors."""
    if isinstance(error, TimeoutError):
        return errno.ETIMEDOUT
    first = error.args[0] if error.args else None
    return first if isinstance(first, int) and first > 0 else None

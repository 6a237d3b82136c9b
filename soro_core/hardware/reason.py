"""What the operating system says is wrong with a port, a connection or a path, and what to do."""

from __future__ import annotations

import errno
import os

IN_USE = "in use by another program"

_LOOK, _AGAIN = "look at its cable and supply", "start the other side again"
_DO = {
    errno.ENOENT: "plug it in or start what makes it, or mend the path",
    errno.EACCES: "`soro doctor` says how to get the right to it",
    errno.ENOTTY: "it is no serial port, so mend the path",
    errno.EIO: _LOOK,
    errno.ENXIO: _LOOK,
    errno.ENODEV: _LOOK,
    errno.ECONNREFUSED: "start what serves it, or mend the address",
    errno.ECONNRESET: _AGAIN,
    errno.EPIPE: _AGAIN,
    errno.ETIMEDOUT: f"{_LOOK}, and at the address",
    errno.EHOSTUNREACH: f"{_LOOK}, and at the address",
    errno.ENETUNREACH: f"{_LOOK}, and at the address",
}


def reason(error: BaseException) -> str:
    """Reason of a failed call in one line, once and without numbers.

    Libraries wrap errors of the system in their own and write the first one's text into theirs.

    Parameters
    ----------
    error : Exception
        An `OSError`, or what a library (pyserial, termios) has made of one.
    """
    number = _number(error) or (_number(error.__context__) if error.__context__ else None)
    if number is None:
        return getattr(error, "strerror", None) or str(error)
    if number == errno.EAGAIN:  # of a lock
        return f"{IN_USE}; end that program"
    advice = _DO.get(number)
    return f"{os.strerror(number)}; {advice}" if advice else os.strerror(number)


def no_socket(error: OSError) -> str:
    """Reason why a Unix socket could not be made; one that is left over was taken away before."""
    return "a file of that name is in the way" if error.errno == errno.EADDRINUSE else reason(error)


def _number(error: BaseException) -> int | None:
    """Error number of the system, which is the first argument of more than `OSError`."""
    if isinstance(error, TimeoutError):
        return errno.ETIMEDOUT
    first = error.args[0] if error.args else None
    return first if isinstance(first, int) and first > 0 else None

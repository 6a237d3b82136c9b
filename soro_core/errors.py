"""Errors that soro raises on purpose: one line that states what is wrong, where, and what is allowed."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from difflib import get_close_matches
from pathlib import Path

# Largest number of characters of the found value in an error.
LONGEST = 80


class SoroError(Exception):
    """Base of all errors that a user can cause or mend; they pass from process to process as they are."""

    def __reduce__(self) -> tuple[Callable[..., SoroError], tuple[object, ...]]:
        return _received, (type(self), self.args, vars(self))


def _received(kind: type[SoroError], args: tuple[object, ...], values: dict[str, object]) -> SoroError:
    error = kind.__new__(kind, *args)
    vars(error).update(values)
    return error


# What is said of a parameter that a running node cannot take over.
NEXT_CONFIGURE = "takes effect at the next configure"


class ConfigError(SoroError):
    """A value in a file or a parameter is not allowed.

    Parameters
    ----------
    where : str
        File (or dictionary, or node) of the value.
    key : str
        Dotted path of the key, empty for the whole file.
    got : object
        What was found.
    allowed : str
        What is allowed there.
    is_rule : bool
        Whether that is a rule across keys, which a whole mapping breaks; implied by an empty `key`.
    """

    def __init__(self, where: str, key: str, got: object, allowed: str, is_rule: bool = False) -> None:
        self.where, self.key, self.got, self.allowed = where, key, got, allowed
        at = f"{where}: {key}" if key else where
        # The beginning of a long mapping does not show which rule across its keys is broken.
        is_long = (is_rule or not key) and isinstance(got, dict) and len(repr(got)) > LONGEST
        found = "" if is_long else f"got {short(got)}; "
        super().__init__(f"{at}: {found}allowed: {allowed}")


class ModelError(SoroError):
    """A model has no value for a request (a strain of -1, a wrong shape).

    Parameters
    ----------
    text : str
        One line.
    key : str
        Argument or quantity that is wrong (``dt``, ``q0``, ``elongation``); empty where it is no single one.
    """

    def __init__(self, text: str, key: str = "") -> None:
        self.key = key
        super().__init__(text)


HARDWARE_CODES = {
    "open": "a port, an adapter, a server or a socket cannot be opened",
    "gone": "a connection that was open is lost",
    "silent": "no answer has come in time",
    "refused": "a device or an adapter does not answer as requested",
    "flood": "bytes or frames come without a pause",
    "setting": "the platform, the endpoint or an argument lacks a value, or has a wrong one",
    "order": "a call came before configure or after close",
    "pressure": "a chamber is not empty after set point 0",
    "vented": "the limiter has vented during a measurement",
}


class HardwareError(SoroError):
    """A device, a bus or an adapter did not follow its protocol.

    Parameters
    ----------
    text : str
        What happened; the message is ``device: step: text``.
    device : str
        Address, path or name of the part, for example ``link0/chamber1 (node 2)``.
    code : str
        One of `HARDWARE_CODES`, or of the drivers' `FAULT_CODES` for a fault.
    step : str
        Step of the start-up.
    """

    def __init__(self, text: str, device: Path | str = "", code: str = "", step: str = "") -> None:
        self.text, self.device, self.code, self.step = text, str(device), code, step
        super().__init__(": ".join(part for part in (self.device, step, text) if part))


BAG_CODES = {
    "missing": "there is no such file, folder or topic",
    "exists": "the folder or the topic is there already",
    "closed": "the bag is closed",
    "damaged": "bytes are not what the format says",
    "format": "a storage, compression or version that is not read",
    "disk": "the operating system refuses to read or to write, or the disk is too small",
    "value": "an argument or a value in metadata.yaml is not allowed",
}


class BagError(SoroError):
    """A recording cannot be read or written.

    Parameters
    ----------
    text : str
        What is wrong; the message is ``file: place: text``.
    file : path or str
        File or folder of the bag.
    code : str
        One of `BAG_CODES`.
    place : str
        Where in it: a byte (``byte 1234``), a key of metadata.yaml, a topic.
    """

    def __init__(self, text: str, file: Path | str = "", code: str = "", place: str = "") -> None:
        self.text, self.file, self.code, self.place = text, str(file), code, place
        super().__init__(": ".join(part for part in (self.file, place, text) if part))


def short(value: object) -> str:
    """Return what was found as part of one line."""
    text = " ".join(repr(value).split())
    return text if len(text) <= LONGEST else text[: LONGEST - 3] + "..."


def nearest(name: str, known: Iterable[str]) -> str:
    """Return the end of a line that asks whether one of the known names is meant; "" where none is near."""
    found = get_close_matches(name, list(known), n=1)
    return f"; did you mean {found[0]}?" if found else ""

"""Every error that soro raises on purpose: one line that says what, where, and what is allowed."""

from __future__ import annotations

# Characters of what was found that stand in an error.
LONGEST = 80


class SoroError(Exception):
    """Base of all errors that a user can cause or mend."""


class ConfigError(SoroError):
    """A value in a file or a parameter is not allowed.

    Parameters
    ----------
    where : str
        File (or dictionary, or node) in which the value stands.
    key : str
        Dotted path of the key, empty for the whole file.
    got : object
        What was found.
    allowed : str
        What is allowed there.
    is_rule : bool
        Whether that is a rule across keys, which a whole mapping breaks; so it is where `key` is empty.
    """

    def __init__(self, where: str, key: str, got: object, allowed: str, is_rule: bool = False) -> None:
        self.where, self.key, self.got, self.allowed = where, key, got, allowed
        at = f"{where}: {key}" if key else where
        # The beginning of a long mapping says nothing of a rule across its keys.
        is_long = (is_rule or not key) and isinstance(got, dict) and len(repr(got)) > LONGEST
        found = "" if is_long else f"got {short(got)}; "
        super().__init__(f"{at}: {found}allowed: {allowed}")


class ModelError(SoroError):
    """A model was asked for something that it has no value for (a strain of -1, a wrong shape)."""


class HardwareError(SoroError):
    """A device, a bus or an adapter did not do what its protocol says."""


class BagError(SoroError):
    """A recording cannot be read or written."""


def short(value: object, limit: int = LONGEST) -> str:
    """Return what was found as part of one line."""
    text = " ".join(repr(value).split())
    return text if len(text) <= limit else text[: limit - 3] + "..."

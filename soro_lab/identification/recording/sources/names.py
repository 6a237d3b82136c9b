"""Streams of several recordings that have one name must show one thing."""

from __future__ import annotations

from collections.abc import Sequence

from soro_core.errors import ConfigError
from soro_lab.identification.recording.recording import Recording


def check_names(recordings: Sequence[Recording]) -> None:
    """Refuse recordings whose streams of shape have one name and are of different kinds.

    A name stands for one sensor in all recordings: its range, its expected error and its frame.

    Raises
    ------
    ConfigError
        That names the recording and the stream.
    """
    kinds: dict[str, tuple[type, str]] = {}
    for recording in recordings:
        for shape in recording.shapes:
            kind, first = kinds.setdefault(shape.name, (type(shape), recording.name))
            if kind is not type(shape):
                text = f"{type(shape).__name__.lower()} here, {kind.__name__.lower()} in {first}"
                allowed = "one kind under one name: give one of them another name in its column map"
                raise ConfigError(recording.name, shape.name, text, allowed)

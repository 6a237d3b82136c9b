"""Recordings in which nothing moves identify nothing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from soro_core.errors import ConfigError
from soro_lab.identification.recording.recording import Recording
from soro_lab.identification.recording.stillness import noise
from soro_lab.identification.recording.streams import Stream

# A range below so many deviations of the noise is noise: that of 10 000 samples spans 8.
_NOISE = 10.0


def moves(stream: Stream) -> bool:
    """Return whether a stream moves by more than its noise."""
    table = stream.motion()
    return len(table) > 3 and bool((np.ptp(table, axis=0) > _NOISE * noise(stream)).any())


def check_motion(recordings: Sequence[Recording]) -> None:
    """Refuse recordings in none of which the arm moves; one at rest among others is evidence of the rest.

    Raises
    ------
    ConfigError
        That names them.
    """
    if not any(moves(stream) for recording in recordings for stream in recording.shapes):
        names = ", ".join(recording.name for recording in recordings) or "no recording"
        raise ConfigError(names, "", "no motion", "one or more recordings in which the arm moves")

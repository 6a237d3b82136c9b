"""How the processes of a run ended."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class End:
    """How the processes ended.

    Attributes
    ----------
    status : int
        Exit status: 2 if the run was refused, another value but 0 if it ended early.
    error : str
        The first error; empty without one.
    warnings : tuple of str
        What happened to nodes without which the arm goes on.
    recording_failure : str
        Why the recording has no end; empty where it has one.
    said : mapping of str to str
        Warnings that stood, by node, for a run without a recording.
    has_begun : bool
        Whether control was enabled; nothing moves before.
    """

    status: int = 0
    error: str = ""
    warnings: tuple[str, ...] = ()
    recording_failure: str = ""
    said: Mapping[str, str] = field(default_factory=dict)
    has_begun: bool = True

"""Words by which nodes say that they give nothing, or have vented; without ROS, for who reads them."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:  # with the code of the filter
    from soro_core.adaptation.external_force import Stage

# Of a controller while it sends no command, and of an estimator without an estimate.
NO_COMMAND, NO_ESTIMATE = "no command", "no estimate"
# Of a node that drives valves, while its latch is closed; and behind it, if someone asked for the vent.
VENTED, REQUESTED = "vented", "vent requested"
# Stages of an outside force on the arm, in the order of their numbers on topics.
STAGES: tuple[Stage, ...] = ("free", "outside force", "contact")


def is_requested(message: str) -> bool:
    """Whether a node says that its arm is vented because someone asked for it, and has become empty."""
    return message == f"{VENTED}: {REQUESTED}"


def add_prefix(prefix: str, text: str) -> str:
    """Return a text that begins with one of the words above, once; an empty one stays empty."""
    return text if not text or text.startswith(prefix) else f"{prefix}: {text}"


def node_of(name: str, prefix: str) -> str | None:
    """Return the name of a node of the arm /prefix/ from its full one; None for a node of another arm.

    What arms share, such as the regulators of their valves, has its node in the namespace around theirs.
    """
    around = prefix.rstrip("/").rpartition("/")[0]
    if name.startswith(prefix):
        return name.removeprefix(prefix)
    is_shared = bool(around) and name.rpartition("/")[0] == around
    return name.rpartition("/")[2] if is_shared else None

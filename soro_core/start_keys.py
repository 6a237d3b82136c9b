"""Keys of the start of every node."""

from __future__ import annotations

from pydantic import Field

from soro_core.config import Strict


class StartKeys(Strict):
    """Keys of the start of a node."""

    autostart: bool = Field(True, description="configure and activate at start")
    end_on_failed_start: bool = Field(
        False,
        description="end the process if autostart fails, as soro run has it; otherwise the node stays, and a "
        "later transition may succeed",
    )

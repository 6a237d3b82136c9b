"""Laws: each a part behind one protocol, named in a registry (docs/adding_a_law.md)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from soro_core.extras import lazy

if TYPE_CHECKING:
    from soro_core.control.laws.protocol import (
        ArmBelief,
        Certainty,
        Law,
        LawOptions,
        Made,
        Preview,
        Setting,
        Terms,
    )

__all__ = ["ArmBelief", "Certainty", "Law", "LawOptions", "Made", "Preview", "Setting", "Terms"]

__getattr__ = lazy(__name__, dict.fromkeys(__all__, "soro_core.control.laws.protocol"))

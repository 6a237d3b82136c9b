"""The twin: a plant that may be finer than the controller's model, its air and its sensors."""

from __future__ import annotations

from typing import TYPE_CHECKING

from soro_core.extras import lazy

if TYPE_CHECKING:
    from soro_core.twin.config import SensorConfig, TwinConfig
    from soro_core.twin.twin import Observation, Twin, TwinState

__all__ = ["Observation", "SensorConfig", "Twin", "TwinConfig", "TwinState"]

__getattr__ = lazy(
    __name__,
    {
        "Observation": "soro_core.twin.twin",
        "SensorConfig": "soro_core.twin.config",
        "Twin": "soro_core.twin.twin",
        "TwinConfig": "soro_core.twin.config",
        "TwinState": "soro_core.twin.twin",
    },
)

"""The twin: a plant that may be finer than the controller's model, its air and its sensors."""

from typing import TYPE_CHECKING

from soro_core.extras import lazy

if TYPE_CHECKING:
    from soro_core.twin.config import SensorConfig as SensorConfig
    from soro_core.twin.config import TwinConfig as TwinConfig
    from soro_core.twin.twin import Observation as Observation
    from soro_core.twin.twin import Twin as Twin
    from soro_core.twin.twin import TwinState as TwinState

__all__, __getattr__ = lazy(
    __name__,
    {
        ".config": "SensorConfig TwinConfig",
        ".twin": "Observation Twin TwinState",
    },
)

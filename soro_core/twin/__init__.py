"""The twin: a plant that may be finer than the controller's model, its air and its sensors."""

from soro_core.twin.config import SensorConfig, TwinConfig
from soro_core.twin.twin import Observation, Twin, TwinState

__all__ = ["Observation", "SensorConfig", "Twin", "TwinConfig", "TwinState"]

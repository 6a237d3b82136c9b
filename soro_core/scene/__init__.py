"""A scene says what exists and what runs: robot, platform, twin, estimator, controller, recorder."""

from soro_core.scene.check import check_model
from soro_core.scene.model import ModelSection, Wish
from soro_core.scene.nodes import ControllerNodeConfig, EstimatorNodeConfig, RegulatorNodeConfig
from soro_core.scene.scene import Scene, load_scene

__all__ = [
    "ControllerNodeConfig",
    "EstimatorNodeConfig",
    "ModelSection",
    "RegulatorNodeConfig",
    "Scene",
    "Wish",
    "check_model",
    "load_scene",
]

"""A scene describes a run: robot, platform, twin, estimator, controller, recorder."""

from soro_core.scene.check import check_gains, check_model, check_plant, check_scene
from soro_core.scene.load import load_scene
from soro_core.scene.model import ModelSection, Requirement
from soro_core.scene.nodes import (
    ControllerNodeConfig,
    EstimatorNodeConfig,
    ExciterNodeConfig,
    MarkersConfig,
    RegulatorNodeConfig,
)
from soro_core.scene.scene import Scene

__all__ = [
    "ControllerNodeConfig",
    "EstimatorNodeConfig",
    "ExciterNodeConfig",
    "MarkersConfig",
    "ModelSection",
    "RegulatorNodeConfig",
    "Requirement",
    "Scene",
    "check_gains",
    "check_model",
    "check_plant",
    "check_scene",
    "load_scene",
]

"""A scene describes a run: robot, platform, twin, estimator, controller, recorder."""

from soro_lab.scene.check import (
    arm_of,
    check_gains,
    check_learned,
    check_model,
    check_plant,
    check_scene,
    require_one_arm,
)
from soro_lab.scene.load import load_scene
from soro_lab.scene.model import ModelSection, Requirement
from soro_lab.scene.nodes import (
    ControllerNodeConfig,
    EstimatorNodeConfig,
    ExciterNodeConfig,
    MarkersConfig,
    RegulatorNodeConfig,
)
from soro_lab.scene.scene import Scene

__all__ = [
    "ControllerNodeConfig",
    "EstimatorNodeConfig",
    "ExciterNodeConfig",
    "MarkersConfig",
    "ModelSection",
    "RegulatorNodeConfig",
    "Requirement",
    "Scene",
    "arm_of",
    "check_gains",
    "check_learned",
    "check_model",
    "check_plant",
    "check_scene",
    "load_scene",
    "require_one_arm",
]

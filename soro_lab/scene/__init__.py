"""A scene describes a run: robot, platform, twin, estimator, controller, recorder."""

from soro_lab.scene.check import arm_of as arm_of
from soro_lab.scene.check import check_gains as check_gains
from soro_lab.scene.check import check_learned as check_learned
from soro_lab.scene.check import check_model as check_model
from soro_lab.scene.check import check_plant as check_plant
from soro_lab.scene.check import check_scene as check_scene
from soro_lab.scene.check import require_one_arm as require_one_arm
from soro_lab.scene.load import load_scene as load_scene
from soro_lab.scene.model import ModelSection as ModelSection
from soro_lab.scene.model import Requirement as Requirement
from soro_lab.scene.nodes import ControllerNodeConfig as ControllerNodeConfig
from soro_lab.scene.nodes import EstimatorNodeConfig as EstimatorNodeConfig
from soro_lab.scene.nodes import ExciterNodeConfig as ExciterNodeConfig
from soro_lab.scene.nodes import HandNodeConfig as HandNodeConfig
from soro_lab.scene.nodes import MarkersConfig as MarkersConfig
from soro_lab.scene.nodes import RegulatorNodeConfig as RegulatorNodeConfig
from soro_lab.scene.robot_files import with_robot_files as with_robot_files
from soro_lab.scene.scene import Scene as Scene

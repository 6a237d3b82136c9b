"""Parameters of the nodes that wrap one object of the core each.

What several nodes must agree on (robot, mode, rate, limits) stands in `soro_core.run_keys`.
"""

from __future__ import annotations

from pydantic import Field

from soro_core.config import Strings, with_changes
from soro_core.control.config import ControllerConfig, ReferenceConfig
from soro_core.control.pressures.actuation import CompletePressures, complete_pressures, contradictions
from soro_core.estimation.config import EstimatorConfig
from soro_core.grasping.settings import HandKeys
from soro_core.pneumatics.regulator import RegulatorModel
from soro_core.robot import Discretisation
from soro_core.run_keys import ArmNodeKeys, LimitKeys, NodeKeys, PlaceKeys, Priority, RobotKeys, StartKeys
from soro_core.safety import Limits
from soro_hardware import PlatformBase, load_platform
from soro_lab.excitation.config import ExciteConfig


class RegulatorNodeConfig(NodeKeys, LimitKeys):
    """Parameters of the regulator node."""

    platform: str = Field("emulated_canopen", description="platform file, or the name of a shipped one")
    device: str = Field("", description="adapter or port to use instead of the platform file's")
    priority: Priority = 30
    lockstep_timeout_s: float = Field(10.0, gt=0, le=600, description="wall time without a tick that vents")
    keep_latch: bool = Field(
        True, description="write a note on this machine why the devices are vented, for the next driver"
    )
    follow_shared_name: bool = Field(
        False, description="follow commands also while two publishers give the same name (header.frame_id)"
    )
    take_over: bool = Field(
        False,
        description="start with an open latch although the last driver of these devices was killed or left "
        "them vented; soro run, which a person starts, sets it",
    )


class SampleKeys(PlaceKeys):
    """Keys of the samples that a node waits for in lockstep."""

    pose_rate_hz: float = Field(
        0.0, ge=0, le=1000, description="lockstep: samples of each pose sensor a second; 0 for none"
    )
    pose_delay_s: float = Field(0.0, ge=0, le=1, description="lockstep: their delay")
    imu_rate_hz: float = Field(
        0.0, ge=0, le=1000, description="lockstep: samples of each IMU a second; 0 for none"
    )
    imu_delay_s: float = Field(0.0, ge=0, le=1, description="lockstep: their delay")


class RegulatedKeys(LimitKeys):
    """Keys of the regulators behind the set points of a node."""

    platform: str = Field(
        "emulated_canopen",
        description="platform file or name, as the regulator node has it: range, lag and dead time of the "
        "regulators; empty for a twin in their place",
    )
    regulator: RegulatorModel = Field(
        RegulatorModel(), description="regulators of a twin without platform, as the twin has them"
    )

    def known_limits(
        self, rate_hz: float, platform: PlatformBase | None = None
    ) -> tuple[Limits, RegulatorModel]:
        """Return the limits within the range of the regulators, and how these respond.

        Parameters
        ----------
        rate_hz : float
            Ticks of the loop a second.
        platform : PlatformBase, optional
            The platform that the configuration names, where it is read already.

        Raises
        ------
        ConfigError
            If there is no such platform, or no pressure is left.
        """
        if not self.platform:
            return self.limits, self.regulator
        platform = platform or load_platform(self.platform)
        allowed = platform.range
        low = max(self.limits.minimum_pa, allowed.minimum_pa)
        high = min(self.limits.maximum_pa, allowed.maximum_pa)
        return with_changes(self.limits, minimum_pa=low, maximum_pa=high), platform.response_at(rate_hz)


class EstimatorNodeConfig(ArmNodeKeys, SampleKeys):
    """Parameters of the estimator node."""

    priority: Priority = 20
    backbone_rate_hz: float = Field(20.0, ge=0, le=30, description="rate of arm/backbone and /tf; 0 for none")
    backbone_points: int = Field(21, ge=2, le=200, description="poses along the arm in arm/backbone")
    publish_tf: bool = Field(
        True, description="publish base and tip on /tf_static and /tf, where tf2_msgs is installed"
    )
    learned: bool = Field(
        False, description="lockstep: the law learns, so each tick waits for arm/learned of the one before"
    )
    filter: EstimatorConfig = Field(EstimatorConfig(), description="the filter")


class MarkersConfig(RobotKeys, StartKeys):
    """Parameters of the markers node."""

    rate_hz: float = Field(20.0, ge=1e-3, le=30, description="most pictures a second")
    trail_s: float = Field(4.0, gt=0, le=600, description="time that the trails of tip and reference show")
    full_pa: float = Field(
        0.0,
        ge=0,
        le=1e8,
        description="pressure of the full colour [Pa]; 0: the largest of the robot file",
    )
    around: int = Field(10, ge=3, le=60, description="points of a ring of the skin")
    per_fold: int = Field(2, ge=2, le=12, description="rings a fold of the narrowest bellow")


class ExciterNodeConfig(ArmNodeKeys, RegulatedKeys, SampleKeys):
    """Parameters of the exciter node."""

    priority: Priority = 20
    excite: ExciteConfig = Field(ExciteConfig(), description="the excitation")


class HandNodeConfig(NodeKeys, HandKeys):
    """Parameters of the hand node."""

    priority: Priority = 20
    fingers: Strings = Field(
        ("thumb", "index", "middle"), description="namespaces of the fingers below that of the node"
    )
    robots: Strings = Field(
        ("tue_three_bellow",),
        description="their robot files, or names of shipped ones: one each, or one for all",
    )
    model: Discretisation = Field(Discretisation(), description="how a finger is computed")
    state_age_s: float = Field(
        0.5, gt=0, le=10, description="time without control of a finger after which the hand opens"
    )
    carrier: str = Field(
        "",
        description="namespace of the arm that carries the hand at its tip, below that of the node; or none",
    )
    carrier_robot: str = Field("", description="its robot file")
    carrier_model: Discretisation = Field(Discretisation(), description="how it is computed")


class ControllerNodeConfig(ArmNodeKeys, RegulatedKeys, PlaceKeys):
    """Parameters of the controller node."""

    enabled: bool = Field(False, description="start control at the first arm/state, without ~/enable")
    priority: Priority = 20
    state_age_s: float = Field(
        0.1, gt=0, le=1, description="longest age of a state; the controller ignores older ones"
    )
    # A controller that is started alone has no scene that states a motion, so it holds the arm.
    control: ControllerConfig = Field(
        ControllerConfig(reference=ReferenceConfig(kind="hold")), description="the law and its reference"
    )
    hand: bool = Field(
        False, description="lockstep: a hand moves this arm, each tick waits for arm/reference/trajectory"
    )
    duration_s: float = Field(
        0.0, ge=0, le=86400, description="lockstep: time from which on zero is commanded; 0: never"
    )
    reach: float = Field(
        0.0,
        ge=0,
        le=1,
        description="refuse a configured reference if the best pressures leave the tip further away from it, "
        "part of the arm's length; 0: no check",
    )

    def known_pressures(self, platform: PlatformBase | None = None) -> tuple[CompletePressures, list[str]]:
        """Complete the section `pressures` of the law from limits and regulators.

        Parameters
        ----------
        platform : PlatformBase, optional
            The platform that the configuration names, where it is read already.

        Returns
        -------
        pressures : CompletePressures
        contradictions : list of str
            A line for each key of the section that the limits or the regulators contradict.

        Raises
        ------
        ConfigError
            If there is no such platform, or no pressure is left.
        """
        limits, response = self.known_limits(self.rate_hz, platform)
        stated = self.control.pressures
        # A set point that answers a tick reaches the regulators with the next one.
        complete = complete_pressures(stated, limits, response, self.rate_hz, 1.0 / self.rate_hz)
        return complete, contradictions(stated, limits, response)

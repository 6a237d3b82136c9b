"""Parameters of the nodes that wrap one object of the core each.

What several nodes must agree on (robot, mode, rate) a scene states once and gives to all of them.
"""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from soro_core.config import Strict
from soro_core.control.config import ControllerConfig
from soro_core.estimation.config import EstimatorConfig
from soro_core.robot import Discretisation
from soro_core.safety import Limits

Mode = Literal["real_time", "lockstep"]
_MODE = "real_time, or lockstep: one step a tick, whenever its inputs are complete"

_PRIORITY = "real_time: priority (SCHED_FIFO) where the system permits it; 0 for none"


class RegulatorNodeConfig(Strict):
    """Parameters of the regulator node."""

    autostart: bool = Field(True, description="configure and activate at start")
    platform: str = Field("emulated_canopen", description="platform file, or the name of a shipped one")
    device: str = Field("", description="adapter or port to use instead of the platform file's")
    mode: Mode = Field("real_time", description=_MODE)
    rate_hz: float = Field(200.0, gt=0, le=1000, description="exchanges with the regulators a second")
    priority: int = Field(30, ge=0, le=99, description=_PRIORITY)
    lockstep_timeout_s: float = Field(10.0, gt=0, le=600, description="wall time without a tick that vents")
    limits: Limits = Field(Limits(), description="limits of commands and readings")
    keep_latch: bool = Field(
        True, description="note on this machine why the devices are vented, for the driver after this one"
    )
    take_over: bool = Field(
        False,
        description="begin open although the last driver of these devices was killed or left them vented; "
        "soro run does, which a person starts",
    )


class EstimatorNodeConfig(Strict):
    """Parameters of the estimator node."""

    autostart: bool = Field(True, description="configure and activate at start")
    robot: str = Field("tue_three_bellow", description="robot file, or the name of a shipped one")
    model: Discretisation = Field(Discretisation(), description="how the arm is computed")
    mode: Mode = Field("real_time", description=_MODE)
    rate_hz: float = Field(200.0, gt=0, le=1000, description="expected rate of chambers/state")
    pose_location: float = Field(
        1.0, ge=0, le=1, description="place of sensors/pose0, part of the arm's length"
    )
    imu_location: float = Field(
        1.0, ge=0, le=1, description="place of sensors/imu0, part of the arm's length"
    )
    pose_rate_hz: float = Field(
        0.0, ge=0, le=1000, description="lockstep: samples of sensors/pose0; 0 for none"
    )
    pose_delay_s: float = Field(0.0, ge=0, le=1, description="lockstep: their delay")
    imu_rate_hz: float = Field(
        0.0, ge=0, le=1000, description="lockstep: samples of sensors/imu0; 0 for none"
    )
    imu_delay_s: float = Field(0.0, ge=0, le=1, description="lockstep: their delay")
    priority: int = Field(20, ge=0, le=99, description=_PRIORITY)
    backbone_rate_hz: float = Field(20.0, ge=0, le=30, description="rate of arm/backbone; 0 for none")
    backbone_points: int = Field(21, ge=2, le=200, description="poses along the arm in arm/backbone")
    filter: EstimatorConfig = Field(EstimatorConfig(), description="the filter")


class ControllerNodeConfig(Strict):
    """Parameters of the controller node."""

    autostart: bool = Field(True, description="configure and activate at start")
    enabled: bool = Field(
        False, description="control as soon as arm/state comes, without waiting for ~/enable"
    )
    robot: str = Field("tue_three_bellow", description="robot file, or the name of a shipped one")
    model: Discretisation = Field(Discretisation(), description="how the arm is computed")
    mode: Mode = Field("real_time", description=_MODE)
    rate_hz: float = Field(200.0, gt=0, le=1000, description="expected rate of arm/state")
    priority: int = Field(20, ge=0, le=99, description=_PRIORITY)
    state_age_s: float = Field(0.1, gt=0, le=1, description="older states are not acted on")
    control: ControllerConfig = Field(ControllerConfig(), description="the law and its reference")

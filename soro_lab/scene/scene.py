"""The scene file: its keys, their checks, and the parameters of each node."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

from pydantic import Field, ValidationInfo, field_validator, model_validator

from soro_core.bodies.files import Bodies
from soro_core.config import Strict, with_changes
from soro_core.control.config import ControllerConfig
from soro_core.control.laws.registry import find_law
from soro_core.errors import ConfigError
from soro_core.estimation.config import EstimatorConfig
from soro_core.grasping.settings import HandKeys
from soro_core.pneumatics import RegulatorModel
from soro_core.robot import Discretisation, Robot, load_robot
from soro_core.run_keys import SHARED, ClockKeys, FrameKeys, LimitKeys, RobotKeys, SeedKeys
from soro_core.safety import usable_range
from soro_core.safety.vent_check import REST_S
from soro_core.twin.config import ShadowConfig, ShadowSection, TwinConfig, TwinSection
from soro_hardware import PlatformBase, load_platform
from soro_hardware.emulation.faults.fault_types import Injection
from soro_lab.excitation.config import ExciteConfig
from soro_lab.scene.model import ModelSection
from soro_lab.scene.nodes import (
    ControllerNodeConfig,
    EstimatorNodeConfig,
    ExciterNodeConfig,
    MarkersConfig,
    RegulatorNodeConfig,
)
from soro_lab.scene.sections import (
    OF_RUN,
    BaseKeys,
    RecorderSection,
    VerdictSection,
    sample_keys,
    with_sensor_noise,
)

if TYPE_CHECKING:  # with the model's code
    from soro_core.adaptation.kept import KeptNumbers


class Scene(LimitKeys, SeedKeys, ClockKeys, RobotKeys, FrameKeys, BaseKeys):
    """A run: its robot, platform, duration, and the keys of each node.

    Of several arms each one is a scene too, in `arms`, with the keys of all; its name is that of the run and
    its own, ``three_fingers/left``.
    """

    name: str = Field(
        "", pattern=r"^([a-z0-9_]*|[a-z0-9_]+/[a-z0-9_]+)$", description="name of the run; empty: the file's"
    )
    arms: Mapping[str, Any] = Field(
        {},
        description="several arms by name: of each its robot, place (base_position), controller, twin, ... "
        "where they differ from those of the scene",
    )
    bodies: Bodies = Field(
        {}, description="what the arms touch, by name: shape, mass, place, motion (docs/bodies.md)"
    )
    hand: HandKeys | None = Field(
        None, description="the arms are fingers that squeeze what is between them (soro grasp)"
    )
    description: str = Field("", description="what the run shows, in one line (soro scenes)")
    platform: str = Field(
        "", description="platform file or name; empty: the twin takes the place of the regulator node"
    )
    valves: Literal["emulated", "real"] = Field(
        "emulated", description="emulated: those of the platform are started; real: they exist"
    )
    device: str = Field("", description="valves: real: adapter or port in place of the platform file's")
    arm: Literal["simulated", "real"] = Field(
        "simulated", description="simulated by the twin; real: its sensors publish, the twin runs as a shadow"
    )
    shadow: ShadowSection = Field(ShadowSection(), description="the twin beside a real arm")
    # A loop below 10 Hz does not control an arm; a single node may be slower.
    rate_hz: float = Field(200.0, ge=10, le=1000, description="ticks of the control loop a second")
    duration_s: float = Field(20.0, gt=0, le=86400, description="time under control")
    model: ModelSection | None = Field(
        None,
        description="how the arm is computed: stated, or auto with a requirement; default: as the robot",
    )
    measured: str = Field(
        "", description="CSV of a measured forced run (t, p1 ..., kx, ky) that soro trade compares with"
    )
    twin: TwinSection = Field(TwinSection(), description="the simulated arm and its sensors")
    estimator: EstimatorConfig = Field(
        EstimatorConfig(),
        validate_default=True,
        description="the filter; noise of sensors that it does not state is that of twin",
    )
    controller: ControllerConfig = Field(ControllerConfig(), description="the law and its reference")
    verdict: VerdictSection = Field(VerdictSection(), description="when a run is good, poor or lost")
    excite: ExciteConfig = Field(ExciteConfig(), description="the excitation of soro excite")
    markers: bool = Field(
        False, description="also start the node markers, which draws the arm for RViz and Foxglove"
    )
    recorder: RecorderSection = Field(RecorderSection(), description="the recorder")
    faults: tuple[Injection, ...] = Field(
        (), strict=False, description="faults of the emulated valves, `at` seconds after the start"
    )

    @field_validator("twin", mode="before")
    @classmethod
    def _stated_once(cls, value: Any) -> Any:
        given = dict(value) if isinstance(value, TwinConfig) else value
        decided = TwinConfig.model_fields.keys() - TwinSection.model_fields.keys()
        if isinstance(given, Mapping) and (twice := sorted(decided & set(given))):
            raise ValueError(f"no {twice[0]} under twin: the scene states it at its top, for all nodes")
        return value

    @field_validator("estimator")
    @classmethod
    def _of_its_sensors(cls, value: EstimatorConfig, info: ValidationInfo) -> EstimatorConfig:
        twin = info.data.get("twin")
        return value if twin is None else with_sensor_noise(value, twin)

    @model_validator(mode="after")
    def _consistent(self) -> Scene:
        real, twin = self.valves == "real", self.twin
        contradictions = (
            (
                self.platform and twin.regulator,
                "no regulator under twin beside a platform, which has its own regulator key",
            ),
            (
                self.faults and not self.platform,
                "no faults without a platform: they are those of emulated devices",
            ),
            (
                real and twin.air == "states",
                "no air: states under twin beside valves: real, which hold the air",
            ),
            (real and not self.platform, "no valves: real without a platform, which describes them"),
            (real and self.mode == "lockstep", "no lockstep with valves: real, whose time cannot be stopped"),
            (real and self.faults, "no faults with valves: real, only with emulated ones"),
            (not real and self.device, "no device with valves: emulated, only with real ones"),
            (real and self.bodies, "no bodies with valves: real, only around a simulated arm"),
            (real and self.mounted_on and self.arm != "real", "no mounted_on with real valves but arm: real"),
            (
                not real and self.arm == "real",
                "no arm: real without valves: real, because emulated ones do not supply it",
            ),
        )
        for present, message in contradictions:
            if present:
                raise ValueError(message)
        for name, sensor in (("pose", twin.pose), ("imu", twin.imu)):
            ticks = self.rate_hz / sensor.rate_hz
            if sensor.enabled and abs(ticks - round(ticks)) > 1e-9:
                raise ValueError(
                    f"a {name} rate that divides rate_hz, not {sensor.rate_hz:g} of {self.rate_hz:g}"
                )
        return self

    def to_dict(self) -> dict[str, Any]:
        """Return all keys with their values, also defaults, as in a scene file."""
        values = self.model_dump(mode="json", exclude={"arms"})
        if self.arms:
            own = {name: (arm.to_dict(), arm.is_shared) for name, arm in self.arms.items()}
            for name, carrier in self.mounts.items():  # derived, unless the arm states another one
                arm = self.arms[carrier]
                if own[name][0]["frames"]["world"] == arm.frames.within(arm.name).tip:
                    own[name][0]["frames"].pop("world")
            values["arms"] = {
                name: {
                    key: value
                    for key, value in keys.items()
                    if key not in OF_RUN and not (is_shared and key == "limits")
                }
                for name, (keys, is_shared) in own.items()
            }
        if self.controller.gains.stated:  # the file must say whose they are
            values["controller"]["robot"] = self.gains_robot
        return values

    @cached_property
    def loaded_robot(self) -> Robot:
        """The robot that the scene names, at its place; its file is read once."""
        robot = load_robot(self.robot)
        if self.base_position or self.base_quaternion or "loaded_carrier" in vars(self):
            return robot.replace(**self.place)
        return robot

    @cached_property
    def loaded_platform(self) -> PlatformBase | None:
        """The platform that the scene names, or None; its file is read once."""
        return load_platform(self.platform) if self.platform else None

    @property
    def each(self) -> tuple[Scene, ...]:
        """The scene of each arm; of one arm this one alone."""
        return tuple(self.arms.values()) or (self,)

    @property
    def mounts(self) -> dict[str, str]:
        """Arms that another one carries, and which."""
        return {name: arm.mounted_on for name, arm in self.arms.items() if arm.mounted_on}

    def carried_by(self, arm: Scene) -> list[Scene]:
        """The scenes of the arms at the tip of one."""
        return [self.arms[name] for name, carrier in self.mounts.items() if carrier == arm.prefix.rstrip("/")]

    @property
    def fingers(self) -> tuple[Scene, ...]:
        """The scenes of the arms of its hand: of those that are carried, or of all; none without a hand."""
        carried = tuple(self.arms[name] for name in self.mounts)
        return (carried or self.each) if self.hand is not None else ()

    @property
    def prefix(self) -> str:
        """What stands before the names of the nodes of an arm: ``left/``; empty for a single arm."""
        arm = self.name.partition("/")[2]
        return f"{arm}/" if arm else ""

    @property
    def is_shared(self) -> bool:
        """Whether the platform of an arm feeds others too."""
        return self.loaded_platform is not None and bool(self.loaded_platform.arms)

    @property
    def platforms(self) -> tuple[Scene, ...]:
        """Of each platform the scene whose nodes run it: this one if arms share it, or that of its arm."""
        own = tuple(arm for arm in self.each if arm.platform and not arm.is_shared)
        return (self, *own) if any(arm.is_shared for arm in self.each) else own

    @property
    def own_device(self) -> str:
        """Where real valves are: as the scene says, else as their platform does."""
        return self.device or (self.loaded_platform.device if self.loaded_platform else None) or ""

    def markers_node(self) -> MarkersConfig:
        """Parameters of the markers node."""
        return MarkersConfig(robot=self.robot)

    def with_keys(self, **values: Any) -> Scene:
        """Return the scene with other values of keys; it keeps the loaded robot and platform."""
        other = with_changes(self, **values)
        vars(other).update({name: value for name, value in vars(self).items() if name.startswith("loaded_")})
        return other

    def of_each(self, change: Callable[[Scene], Scene]) -> Scene:
        """Return the scene with each of its arms changed; that of one arm is changed itself."""
        if not self.arms:
            return change(self)
        return self.with_keys(arms={name: change(arm) for name, arm in self.arms.items()})

    def with_robot(self, robot: Robot) -> Scene:
        """Return the scene with another robot in place of the one that its file describes."""
        other = self.with_keys()
        vars(other)["loaded_robot"] = robot
        return other

    def with_learned(self, kept: KeptNumbers) -> Scene:
        """Return the scene whose law starts from learned numbers; it keeps the loaded robot and platform.

        Raises
        ------
        ConfigError
            If its law keeps nothing.
        """
        law, options = self.controller.law, self.controller.law_options
        if "learned" not in find_law(law).Options.model_fields:
            raise ConfigError(
                self.name, "controller.law", law, "composite, which can start from what is kept"
            )
        options = {**options, "learned": kept.model_dump(mode="json")}
        return self.with_keys(controller=with_changes(self.controller, law_options=options))

    @property
    def gains_robot(self) -> str:
        """Name or file of the robot that the gains are for."""
        return self.controller.robot or self.robot

    @property
    def discretisation(self) -> Discretisation:
        """How estimator and controller discretise the robot.

        Raises
        ------
        ConfigError
            If the model is still to be chosen (`soro_lab.trade.with_chosen_model`).
        """
        if self.model is None:
            return Discretisation()
        if self.model.auto:
            raise ConfigError(self.name or "scene", "model.auto", True, "a model that is stated or chosen")
        return self.model.discretisation

    @property
    def regulator(self) -> RegulatorModel:
        """The twin's regulators where there is no platform; a range that they do not state is the robot's."""
        stated = self.twin.regulator or RegulatorModel()
        own = zip(
            ("minimum_pa", "maximum_pa"), usable_range(self.loaded_robot.pressure_range_pa), strict=True
        )
        return with_changes(stated, **{key: end for key, end in own if key not in stated.model_fields_set})

    def _plant(self) -> dict[str, Any]:
        """Keys of the twin: those that follow from the model, and those that `twin` states itself."""
        stated = {name: value for name, value in self.twin if value is not None}
        if not self.platform:
            stated["regulator"] = self.regulator
        if self.model is None:
            return stated
        model = self.discretisation
        from_model = {"refine": 1, "integrator": self.model.integrator, "step_s": self.model.dt_s}
        return {"model": model.quadrature if "refine" in stated else model, **from_model, **stated}

    def _shared(self, config: type[Strict]) -> dict[str, Any]:
        """Values of the keys that a node shares with the scene."""
        names = {name for keys in SHARED if issubclass(config, keys) for name in keys.model_fields}
        return {name: getattr(self, name) for name in names}

    def twin_node(self, plant_link: str = "", fault_link: str = "") -> TwinConfig:
        """Parameters of the twin node.

        Parameters
        ----------
        plant_link, fault_link : str
            Sockets of the emulated valves, where the scene emulates them.
        """
        return TwinConfig(
            **self._plant(),
            **self._shared(TwinConfig),
            pressures="valves" if self.emulates else "measured" if self.platform else "regulators",
            plant_link=plant_link if self.emulates else "",
            plant_chambers=self._of_valves() if self.emulates else (),
            fault_link=fault_link if self.emulates else "",
            duration_s=self.duration_s,
            empty_s=self.limits.vent_limit_s + REST_S,
            mounted_on=self.mounted_on,
            paused=self.mode == "lockstep",
        )

    def _of_valves(self) -> tuple[int, ...]:
        """Return which of the valves feed the chambers of the arm, where these are not all in their order."""
        platform = self.loaded_platform
        fed = () if platform is None else platform.chamber_names
        names = [f"{self.prefix if self.is_shared else ''}{name}" for name in self.loaded_robot.chamber_names]
        return () if tuple(names) == fed else tuple(fed.index(name) for name in names if name in fed)

    @property
    def emulates(self) -> bool:
        """Whether valves are emulated."""
        return bool(self.platform) and self.valves == "emulated"

    def shadow_node(self) -> ShadowConfig:
        """Parameters of the shadow node, beside a real arm."""
        return ShadowConfig(**dict(self.twin_node()), tolerance_m=self.shadow.tolerance_m)

    def regulator_node(self, device: str = "") -> RegulatorNodeConfig:
        """Parameters of the regulator node; `device` is that of emulated valves."""
        return RegulatorNodeConfig(
            **self._shared(RegulatorNodeConfig),
            platform=self.platform,
            device=device if self.emulates else self.device,
            keep_latch=not self.emulates,  # emulated valves end with their run
            take_over=True,
        )

    def estimator_node(self) -> EstimatorNodeConfig:
        """Parameters of the estimator node."""
        return EstimatorNodeConfig(
            **self._shared(EstimatorNodeConfig),
            **sample_keys(self.twin),
            model=self.discretisation,
            learned=find_law(self.controller.law).learns,
            filter=self.estimator,
        )

    def exciter_node(self) -> ExciterNodeConfig:
        """Parameters of the exciter node, which takes the place of estimator and controller."""
        return ExciterNodeConfig(
            **self._shared(ExciterNodeConfig),
            **sample_keys(self.twin),
            platform=self.platform,
            regulator=self.regulator,
            model=self.discretisation,
            excite=self.excite,
        )

    def controller_node(self) -> ControllerNodeConfig:
        """Parameters of the controller node, which waits for `~/enable` until every node is active."""
        return ControllerNodeConfig(
            **self._shared(ControllerNodeConfig),
            platform=self.platform,
            regulator=self.regulator,
            model=self.discretisation,
            control=self.controller,
            pose_locations=self.twin.pose.locations,
            imu_locations=self.twin.imu.locations,
            reach=self.verdict.tip_error_part,
            duration_s=self.duration_s,
        )

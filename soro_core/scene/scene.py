"""The scene file: strict, and stated once."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from pydantic import Field, model_validator

from soro_core.config import Strict, find_config, parse, read_yaml
from soro_core.control.config import ControllerConfig
from soro_core.errors import ConfigError
from soro_core.estimation.config import EstimatorConfig
from soro_core.hardware import load_platform
from soro_core.hardware.emulation.faults import Injection
from soro_core.robot import Discretisation
from soro_core.safety import Limits, Rating, check_rating
from soro_core.scene.model import ModelSection
from soro_core.scene.nodes import ControllerNodeConfig, EstimatorNodeConfig, Mode, RegulatorNodeConfig
from soro_core.twin.config import ShadowConfig, TwinConfig

# Keys of the twin that a scene states at its top, or decides by itself.
STATED_ONCE = frozenset(
    (
        "robot",
        "mode",
        "rate_hz",
        "seed",
        "limits",
        "pressures",
        "plant_link",
        "fault_link",
        "autostart",
        "duration_s",
        "paused",
        "priority",
        "model",
    )
)


class RecorderSection(Strict):
    """What is recorded."""

    enabled: bool = Field(True, description="record a bag")
    exclude: tuple[str, ...] = Field((), strict=False, description="topics that are not recorded")


class ShadowSection(Strict):
    """What is expected of the twin beside a real arm."""

    tolerance_m: float = Field(
        0.02, gt=0, le=10, description="distance of the measured tip from the shadow's that is warned of"
    )


class Scene(Strict):
    """A run: which robot, on which platform, with which parts, for how long."""

    name: str = Field("", pattern=r"^[a-z0-9_]*$", description="name of the run; the file's name if empty")
    robot: str = Field("tue_three_bellow", description="robot file, or the name of a shipped one")
    platform: str = Field(
        "", description="platform file or name; empty: the twin takes the place of the regulator node"
    )
    mode: Mode = Field("real_time", description="real_time, or lockstep: deterministic, as fast as possible")
    valves: Literal["emulated", "real"] = Field(
        "emulated", description="emulated: those of the platform are started; real: they are there"
    )
    device: str = Field("", description="valves: real: adapter or port in place of the platform file's")
    arm: Literal["simulated", "real"] = Field(
        "simulated", description="simulated by the twin; real: sensors are there, the twin runs as a shadow"
    )
    shadow: ShadowSection = Field(ShadowSection(), description="the twin beside a real arm")
    rate_hz: float = Field(200.0, ge=10, le=1000, description="rate of the control loop")
    duration_s: float = Field(20.0, gt=0, le=86400, description="time under control")
    seed: int = Field(1, ge=0, le=2**31, description="seed of all noise")
    limits: Limits = Field(Limits(), description="limits of commands and readings")
    model: ModelSection | None = Field(
        None, description="how the arm is computed: stated, or auto with a wish; default: as the robot file"
    )
    measured: str = Field(
        "", description="CSV of a measured forced run (t, p1 ..., kx, ky) that soro trade compares with"
    )
    twin: TwinConfig = Field(TwinConfig(), description="the simulated arm and its sensors")
    estimator: EstimatorConfig = Field(EstimatorConfig(), description="the filter")
    controller: ControllerConfig = Field(ControllerConfig(), description="the law and its reference")
    recorder: RecorderSection = Field(RecorderSection(), description="the recorder")
    faults: tuple[Injection, ...] = Field(
        (), strict=False, description="what goes wrong with the emulated valves, `at` seconds after the start"
    )

    @model_validator(mode="after")
    def _stated_once(self) -> Scene:
        twice = sorted(STATED_ONCE & self.twin.model_fields_set)
        if twice:
            raise ValueError(f"no {twice[0]} under twin: the scene states it at its top and gives it to all")
        if self.platform and "regulator" in self.twin.model_fields_set:
            raise ValueError("no regulator under twin beside a platform, whose emulation.regulator counts")
        if self.faults and not self.platform:
            raise ValueError("no faults without a platform: they are those of emulated devices")
        if self.valves == "real" and self.twin.air == "states":
            raise ValueError("no air: states under twin beside valves: real, which hold the air")
        self._hardware()
        for name, sensor in (("pose", self.twin.pose), ("imu", self.twin.imu)):
            ticks = self.rate_hz / sensor.rate_hz
            if sensor.enabled and abs(ticks - round(ticks)) > 1e-9:
                raise ValueError(
                    f"a {name} rate that divides rate_hz, not {sensor.rate_hz:g} of {self.rate_hz:g}"
                )
        return self

    def _hardware(self) -> None:
        """Whether what is real can be."""
        if self.valves == "real":
            if not self.platform:
                raise ValueError("no valves: real without a platform, which says what they are")
            if self.mode != "real_time":
                raise ValueError("no lockstep with valves: real, whose time nobody holds up")
            if self.faults:
                raise ValueError("no faults with valves: real, only with emulated ones")
        elif self.device:
            raise ValueError("no device with valves: emulated, only with real ones")
        elif self.arm == "real":
            raise ValueError("no arm: real without valves: real, for emulated ones do not feed it")

    def to_dict(self) -> dict[str, Any]:
        """All keys with their values, defaults too, as a scene file has them."""
        elsewhere = STATED_ONCE | {"regulator"} if self.platform else STATED_ONCE
        return self.model_dump(mode="json", exclude={"twin": set(elsewhere)})

    @property
    def discretisation(self) -> Discretisation:
        """How estimator and controller discretise the robot.

        Raises
        ------
        ConfigError
            If the model is still to be chosen (`soro_core.trade.with_chosen_model`).
        """
        if self.model is None:
            return Discretisation()
        if self.model.auto:
            raise ConfigError(self.name or "scene", "model.auto", True, "a model that is stated or chosen")
        return self.model.discretisation

    def _plant(self) -> dict[str, Any]:
        """What the model says of the twin, which keeps what it states itself, like a finer plant."""
        model, own = self.discretisation, self.twin.model_fields_set
        if self.model is None:
            return {}
        values = {"refine": 1, "integrator": self.model.integrator, "step_s": self.model.dt_s}
        values = {name: value for name, value in values.items() if name not in own}
        return {"model": model if "refine" in values else model.quadrature, **values}

    def twin_node(self, plant_link: str = "", fault_link: str = "") -> TwinConfig:
        """Parameters of the twin node, with the sockets of the emulated valves."""
        emulated = self.emulates
        return self.twin.model_copy(
            update={
                "robot": self.robot,
                "mode": self.mode,
                "rate_hz": self.rate_hz,
                "seed": self.seed,
                "limits": self.limits,
                "pressures": self._source(),
                "plant_link": plant_link if emulated else "",
                "fault_link": fault_link if emulated else "",
                "duration_s": self.duration_s,
                "paused": self.mode == "lockstep",
                **self._plant(),
            }
        )

    @property
    def emulates(self) -> bool:
        """Whether valves are emulated."""
        return bool(self.platform) and self.valves == "emulated"

    def _source(self) -> Literal["regulators", "valves", "measured"]:
        """Where the twin has its pressures from."""
        if not self.platform:
            return "regulators"
        return "valves" if self.emulates else "measured"

    def shadow_node(self) -> ShadowConfig:
        """Parameters of the shadow node, beside a real arm."""
        values = {**self.twin_node().model_dump(), "tolerance_m": self.shadow.tolerance_m}
        return parse(values, ShadowConfig, where=f"scene {self.name}")

    def regulator_node(self, device: str = "") -> RegulatorNodeConfig:
        """Parameters of the regulator node; `device` is that of emulated valves."""
        return RegulatorNodeConfig(
            platform=self.platform,
            device=device if self.emulates else self.device,
            mode=self.mode,
            rate_hz=self.rate_hz,
            limits=self.limits,
            keep_latch=not self.emulates,  # those of a run are gone with it
            take_over=True,
        )

    def estimator_node(self) -> EstimatorNodeConfig:
        """Parameters of the estimator node."""
        pose, imu = self.twin.pose, self.twin.imu
        return EstimatorNodeConfig(
            robot=self.robot,
            model=self.discretisation,
            mode=self.mode,
            rate_hz=self.rate_hz,
            pose_location=pose.location,
            imu_location=imu.location,
            pose_rate_hz=pose.rate_hz if pose.enabled else 0.0,
            pose_delay_s=pose.delay_s,
            imu_rate_hz=imu.rate_hz if imu.enabled else 0.0,
            imu_delay_s=imu.delay_s,
            filter=self.estimator,
        )

    def controller_node(self) -> ControllerNodeConfig:
        """Parameters of the controller node; not enabled: it waits, so that everybody is there at t = 0."""
        # What the limiter would refuse is not to be asked for: the controller knows these as its bounds.
        asked = self.controller.pressures
        bounds = {
            "minimum_pa": max(asked.minimum_pa, self.limits.minimum_pa),
            "maximum_pa": min(asked.maximum_pa, self.limits.maximum_pa),
        }
        pressures = asked.model_copy(update=bounds)
        return ControllerNodeConfig(
            robot=self.robot,
            model=self.discretisation,
            mode=self.mode,
            rate_hz=self.rate_hz,
            control=self.controller.model_copy(update={"pressures": pressures}),
        )


def load_scene(name: str | Path, changes: dict[str, Any] | None = None) -> Scene:
    """Read a scene, by path or by name, with changes like ``{"controller.adapt": False}`` applied.

    Raises
    ------
    ConfigError
        Naming the file, the key, what was found and what is allowed.
    """
    path = find_config(name, "scenes")
    data = read_yaml(path)
    for key, value in (changes or {}).items():
        _set(data, key, value, str(path))
    data.setdefault("name", path.stem)
    scene = parse(data, Scene, where=str(path))
    platform = load_platform(scene.platform) if scene.platform else None
    check_rating(scene.limits, platform.rating if platform else Rating(), where=str(path))
    for number, fault in enumerate(scene.faults):
        if platform and fault.chamber and fault.chamber not in platform.chamber_names:
            allowed = f"one of {', '.join(platform.chamber_names)}"
            raise ConfigError(str(path), f"faults[{number}].chamber", fault.chamber, allowed)
    return scene


def _set(data: dict[str, Any], key: str, value: Any, where: str) -> None:
    *parents, leaf = key.split(".")
    for parent in parents:
        inner = data.setdefault(parent, {})
        if not isinstance(inner, dict):
            raise ConfigError(where, key, value, f"{parent} is a value, not a section")
        data = inner
    data[leaf] = value

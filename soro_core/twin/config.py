"""Parameters of the twin: how fine its arm is, how it differs from the robot file, and its sensors."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping
from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo, field_validator, model_validator

from soro_core.config import Floats, Strict
from soro_core.errors import ConfigError
from soro_core.pneumatics import RegulatorModel, ValveModel
from soro_core.robot import Robot, Shake, load_robot
from soro_core.robot.discretisation import Integrator
from soro_core.run_keys import ArmNodeKeys, LimitKeys, Priority, SeedKeys, check_places
from soro_core.twin.push import SAME_S, Wall, WrenchChanges

# Largest mass at the tip [kg].
HEAVIEST_KG = 5.0
# What 1,000 load cycles leave of the stiffness of a twin; assumed, to try how ageing is found.
LEFT_BY_1000 = 0.99


class SensorConfig(Strict):
    """A sampled, delayed, noisy sensor on the arm."""

    enabled: bool = Field(True, description="whether it exists")
    rate_hz: float = Field(100.0, gt=0, le=1000, description="samples a second; must divide the twin's rate")
    delay_s: float = Field(0.005, ge=0, le=1, description="time from sampling to publication")
    locations: Floats = Field(
        (1.0,),
        min_length=1,
        description="places on the backbone as parts of its length, of sensors/pose0, pose1, ... (imu0, ...)",
    )
    drop: float = Field(
        0.0, ge=0, lt=1, description="probability that a sample is lost: the last one is repeated"
    )
    outlier: float = Field(0.0, ge=0, lt=1, description="probability that a sample is far off")
    position_noise_m: float = Field(
        3e-4, ge=0, le=1, description="standard deviation of each coordinate (pose)"
    )
    rotation_noise_rad: float = Field(
        5e-3, ge=0, le=10, description="standard deviation of each rotation (pose, IMU)"
    )
    rate_noise_rad_s: float = Field(
        5e-3, ge=0, le=1e3, description="standard deviation of the angular velocity (IMU)"
    )
    acceleration_noise_m_s2: float = Field(
        5e-2, ge=0, le=1e3, description="standard deviation of the acceleration (IMU)"
    )

    @model_validator(mode="before")
    @classmethod
    def _of_one_place(cls, value: Any) -> Any:
        """Take `location`, as the key was called when there was one place."""
        if isinstance(value, Mapping) and "location" in value:
            if "locations" in value:
                raise ValueError("location or locations, not both")
            value = dict(value)
            value["locations"] = (value.pop("location"),)
        return value

    @field_validator("locations")
    @classmethod
    def _places(cls, values: tuple[float, ...]) -> tuple[float, ...]:
        return check_places(values)


class PayloadChanges(Strict):
    """When the mass at the tip becomes another one: a time and a mass for each change."""

    at_s: Floats = Field((), description="times after the begin of control, increasing")
    payload_kg: Floats = Field(
        (), description="mass at the tip from each of these times on, in place of the last"
    )

    @model_validator(mode="after")
    def _pairs(self) -> PayloadChanges:
        if len(self.at_s) != len(self.payload_kg):
            raise ValueError(f"as many times as masses, not {len(self.at_s)} and {len(self.payload_kg)}")
        if any(late <= early for early, late in pairwise((0.0, *self.at_s))):
            raise ValueError("times above 0 that increase")
        if any(not 0.0 <= mass <= HEAVIEST_KG for mass in self.payload_kg):
            raise ValueError(f"masses from 0 to {HEAVIEST_KG:g} kg")
        return self

    def passed(self, t: float) -> int:
        """Number of changes up to `t` seconds after the begin of control."""
        return bisect_right(self.at_s, t + SAME_S)


class TwinSection(Strict):
    """The simulated arm as a scene states it: what differs in truth, its air and its sensors."""

    step_s: float | None = Field(
        None, gt=0, le=0.02, description="longest time step of the arm; default: that of `model`, else 0.0025"
    )
    integrator: Integrator | None = Field(
        None, description="time stepper of the arm; default: that of `model`, else trapezoidal"
    )
    plant: str = Field(
        "",
        description="robot file of the true arm, with the same chambers, which estimator and controller do "
        "not know; default: that of the scene",
    )
    refine: int | None = Field(
        None,
        ge=1,
        le=32,
        description="links of the plant a link of the robot; default: 1 with `model`, else 4",
    )
    payload_kg: float = Field(
        0.0, ge=0, le=HEAVIEST_KG, description="mass at the tip beyond the robot's own, at the begin"
    )
    payload_changes: PayloadChanges = Field(
        PayloadChanges(), description="other masses at the tip, each from some time on"
    )
    wrench: WrenchChanges = Field(
        WrenchChanges(), description="push on the arm, which estimator and controller do not know"
    )
    wall: Wall = Field(Wall(), description="wall in its way, which estimator and controller do not know")
    stiffness_scale: float = Field(1.0, gt=0, le=10, description="true stiffness over the robot file's")
    cycles: float = Field(
        0.0,
        ge=0,
        le=1e6,
        description="load cycles behind the true arm, each 1,000 of which have taken 1 % of its stiffness",
    )
    damping_scale: float = Field(1.0, ge=0, le=10, description="true damping over the robot file's")
    gain_scale: float = Field(1.0, gt=0, le=10, description="true chamber gains over the robot file's")
    pose: SensorConfig = Field(SensorConfig(), description="pose sensors at sensors/pose0, pose1, ...")
    imu: SensorConfig = Field(
        SensorConfig(enabled=False, rate_hz=200.0, delay_s=0.0), description="IMUs at sensors/imu0, imu1, ..."
    )
    regulator: RegulatorModel | None = Field(
        None, description="regulators of a scene without platform; default: those of docs/hardware.md"
    )
    air: Literal["lag", "states"] = Field(
        "lag",
        description="pressures that follow with a lag (here, or in the emulated valves), or (states) valves, "
        "and mass and volume of the air in each chamber, in place of lag and rate limit",
    )
    valve: ValveModel = Field(ValveModel(), description="valves, for air: states")
    base_shake: Shake = Field(
        Shake(), description="swing of the base, which estimator and controller do not know"
    )
    base_by_topic: bool = Field(
        False, description="base/pose moves the base, which estimator and controller do not know"
    )
    follow_shared_name: bool = Field(False, description="as of the regulator node")

    @field_validator("base_shake", "base_by_topic")
    @classmethod
    def _carried(cls, value: Shake | bool, info: ValidationInfo) -> Shake | bool:
        imu, shake = info.data.get("imu"), info.data.get("base_shake", Shake())
        moves = value if isinstance(value, bool) else value.moves
        if moves and (info.data.get("air") == "states" or (imu is not None and imu.enabled)):
            raise ValueError("a base at rest beside air: states or an enabled imu")
        if value is True and shake.moves:
            raise ValueError("false beside a base_shake")
        return value

    @field_validator("valve")
    @classmethod
    def _has_air(cls, value: ValveModel, info: ValidationInfo) -> ValveModel:
        if info.data.get("air") == "lag" and value != ValveModel():
            raise ValueError("none beside air: lag, only beside air: states")
        return value

    def payload_at(self, t: float) -> float:
        """Mass at the tip beyond the robot's own [kg], `t` seconds after the begin of control."""
        return (self.payload_kg, *self.payload_changes.payload_kg)[self.payload_changes.passed(t)]


class TwinConfig(TwinSection, ArmNodeKeys, LimitKeys, SeedKeys):
    """Parameters of the twin: its section of the scene, and what the scene decides for the whole run."""

    step_s: float = Field(0.0025, gt=0, le=0.02, description="longest time step of the arm")
    integrator: Integrator = Field("trapezoidal", description="time stepper of the arm")
    refine: int = Field(4, ge=1, le=32, description="links of the plant a link of the robot")
    regulator: RegulatorModel = Field(RegulatorModel(), description="regulators, for pressures: regulators")
    pressures: Literal["regulators", "valves", "measured"] = Field(
        "regulators",
        description="source of the pressures: regulators of the twin (in place of the regulator node), the "
        "emulated valves of another process, or measured ones on chambers/state (real valves, replay)",
    )
    paused: bool = Field(False, description="wait for ~/start before the first tick")
    duration_s: float = Field(0.0, ge=0, le=86400, description="lockstep: end of time; 0 for none")
    empty_s: float = Field(
        0.0,
        ge=0,
        le=60,
        description="lockstep: longest time behind duration_s until the arm rests with empty chambers",
    )
    plant_link: str = Field("", description="socket of the emulated valves, for pressures: valves")
    plant_chambers: Annotated[tuple[int, ...], Field(strict=False)] = Field(
        (),
        description="which of the emulated valves feed the chambers, by number; empty: all, in their order",
    )
    fault_link: str = Field("", description="socket of the emulated valves that takes the faults of ~/fault")
    bodies_file: str = Field(
        "", description="file whose section bodies has what the arms touch; empty: nothing"
    )
    mounted_on: str = Field(
        "", description="arm of the same process that carries this one at its tip; empty: none"
    )
    priority: Priority = 10

    @model_validator(mode="after")
    def _used(self) -> TwinConfig:
        if self.air == "states" and self.pressures == "measured":
            raise ValueError("air: lag beside pressures: measured, whose air is elsewhere")
        if self.air == "states" and self.plant_chambers:
            raise ValueError("air: lag beside valves that other arms share, or that have another order")
        if self.bodies_file and (allowed := beside_bodies(self)):
            raise ValueError(f"{allowed} beside bodies")
        return self


def beside_bodies(twin: TwinSection) -> str:
    """Return what a twin may not have beside bodies, as what is allowed; empty if it has nothing of it."""
    found = {
        "air: lag": twin.air != "lag",
        "no imu": twin.imu.enabled,
        "no wrench": bool(twin.wrench.at_s),
        "no wall (a body that is fixed is one)": bool(twin.wall.stiffness),
        "no payload_changes": bool(twin.payload_changes.at_s),
        "no base_shake": twin.base_shake.moves,
        "no base_by_topic": twin.base_by_topic,
    }
    return next((allowed for allowed, has in found.items() if has), "")


def described_plant(robot: Robot, config: TwinConfig) -> Robot:
    """Return the robot whose file describes the plant: that of `twin.plant`, or the robot itself.

    Raises
    ------
    ConfigError
        If the file of the plant cannot be read, or its chambers are not those of the robot.
    """
    if not config.plant:
        return robot
    plant = load_robot(config.plant)
    if plant.chamber_names != robot.chamber_names:
        allowed = f"the chambers of the robot: {', '.join(robot.chamber_names)}"
        raise ConfigError(config.plant, "links", ", ".join(plant.chamber_names), allowed)
    return plant


def check_volumes(robot: Robot, where: str, key: str) -> None:
    """Refuse `air: states` for a robot whose chambers have neither a volume nor an area.

    Parameters
    ----------
    robot : Robot
        Robot of the scene or of the node.
    where, key : str
        File or node, and key, for the error.

    Raises
    ------
    ConfigError
        One line that names the first such chamber.
    """
    chambers = [chamber for link in robot.links for chamber in link.chambers]
    for name, chamber in zip(robot.chamber_names, chambers, strict=True):
        if chamber.volume_m3 is None and chamber.alpha_eps == 0.0:
            raise ConfigError(where, key, "states", f"lag, or a volume_m3 of {name} in the robot file")
        if chamber.dead_band_pa > 0.0:
            raise ConfigError(where, key, "states", f"lag, or dead_band_pa 0 of {name} in the robot file")
        if chamber.swell_per_pa > 0.0:
            raise ConfigError(where, key, "states", f"lag, or swell_per_pa 0 of {name} in the robot file")


class ShadowSection(Strict):
    """Keys of the twin beside a real arm."""

    tolerance_m: float = Field(
        0.02, gt=0, le=10, description="distance between measured and simulated pose that is warned of"
    )


class ShadowConfig(TwinConfig, ShadowSection):
    """Parameters of the shadow: those of a twin, and how far the arm may be from it."""

    pressures: Literal["measured"] = Field("measured", description="a shadow takes them from chambers/state")

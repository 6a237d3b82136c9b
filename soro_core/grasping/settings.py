"""How a hand squeezes, and what it is made of."""

from __future__ import annotations

from pydantic import Field, model_validator

from soro_core.arrays import Array
from soro_core.config import Floats, Strict


class SqueezeSettings(Strict):
    """Forces, pressures and times of a squeeze; forces are those of one finger, across it."""

    force_n: float = Field(0.015, gt=0, description="of the first squeeze [N]")
    crush_n: float = Field(
        0.3, gt=0, description="limit of a finger [N]; the hand stops at crush_part of it, by estimate"
    )
    crush_part: float = Field(
        0.85, gt=0, le=1, description="of crush_n at which the force stops: what the estimate may err"
    )
    most_pa: float = Field(90e3, gt=0, description="largest pressure of a chamber that closes a finger [Pa]")
    open_part: float = Field(
        1.0 / 3.0,
        ge=0,
        lt=1,
        description="pressure of all chambers of an open finger, in parts of most_pa; it falls to 0 as the "
        "finger closes: one that does not get longer does not push what it holds. One of three chambers "
        "closes: 1/3",
    )
    close_pa_s: float = Field(10e3, gt=0, description="rate at which fingers close and open [Pa/s]")
    pa_per_n: float = Field(
        5e5,
        gt=0,
        description="pressure for a force, of a finger that touches; the forces of fingers without pose are "
        "known by it alone [Pa/N]",
    )
    touch_pa: float = Field(16e3, ge=0, description="pressure at which a finger without pose touches [Pa]")
    touch_n: float = Field(0.005, gt=0, description="least force that is a touch: what the model may err [N]")
    noise_sigmas: float = Field(5.0, ge=0, description="that a touch is above the noise of the pose")
    filter_s: float = Field(
        0.1, gt=0, description="time constant of poses and pressures, and of a step to a force [s]"
    )
    rise_pa_s: float = Field(
        20e3,
        gt=0,
        description="largest rate at which pressures rise in a slip: fingers that get longer faster than the "
        "object sinks push it, and press harder meanwhile [Pa/s]",
    )
    slip_m: float = Field(1e-3, gt=0, description="tracked slip for which force rises by a factor e [m]")
    blind_s: float = Field(3.0, gt=0, description="the same for one that is not tracked: a time [s]")
    slip_s: float = Field(0.2, gt=0, description="shortest slip [s]")
    still_m: float = Field(
        9e-5, ge=0, description="how far noise moves a tracked object that does not slip, up or down [m]"
    )
    gone_m: float = Field(15e-3, gt=0, description="slip of a tracked object that is lost [m]")
    slip_part: float = Field(
        0.2,
        gt=0,
        lt=1,
        description="part of the force that an untracked slip takes away while the pressures hold",
    )

    @model_validator(mode="after")
    def _order(self) -> SqueezeSettings:
        if not self.touch_n <= self.force_n <= self.limit_n:
            raise ValueError(
                f"touch_n = {self.touch_n:g}, force_n = {self.force_n:g}, crush_part crush_n = "
                f"{self.limit_n:g} N: none above the next one"
            )
        if self.touch_pa > self.most_pa:
            raise ValueError(f"touch_pa = {self.touch_pa:g} Pa: at most most_pa = {self.most_pa:g} Pa")
        return self

    @property
    def limit_n(self) -> float:
        """Estimated force at which the hand does not squeeze harder [N]."""
        return self.crush_part * self.crush_n

    def pressures(self, closing: Array, level_pa: float) -> Array:
        """Return the pressures of a finger, (n_u,) [Pa].

        Parameters
        ----------
        closing : ndarray (n_u,)
            Pressures that close it, in parts of the largest one.
        level_pa : float
            Pressure of the chamber that closes it most, without that of an open finger [Pa].
        """
        return level_pa * closing + self.open_part * (self.most_pa - level_pa)


class HandKeys(Strict):
    """Keys of a hand; its fingers are the arms of the scene."""

    closing: Floats = Field(
        (1.0, 0.0, 0.0), description="pressures that close each finger, in parts of the largest one"
    )
    touch_m: float = Field(0.062, gt=0, description="place along a finger at which it touches [m]")
    off_m: float = Field(5e-3, ge=0, description="how far from it the object may touch [m]")
    pose_noise_m: float = Field(1e-4, ge=0, description="noise of the poses of fingers [m]")
    by_pressure: bool = Field(False, description="squeeze by pressure: the fingers have no poses")
    tracked: str = Field(
        "", description="topic of the poses of the object, bodies/ball/pose; empty: nothing tracks it"
    )
    close_at_s: float = Field(
        0.0, ge=0, le=86400, description="time at which the hand closes by itself; 0: soro grasp asks for it"
    )
    squeeze: SqueezeSettings = Field(SqueezeSettings(), description="forces, pressures and times")

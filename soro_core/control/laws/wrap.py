"""The law `wrap`: along an object, and then the least energy of the arm within the object.

Under pressures u an arm rests where the energy U(q) - q' H u is least. With H u = dU/dq at q*, the shape q*
is that place. Where an object keeps the arm from it, the arm presses with the difference of the forces, dU/dq
at q* less that at q. Nothing is fed back: a filter that knows of a force at the tip alone is wrong about an
arm that leans on something all along, and what a link presses must not depend on it.

The reference is the shape that lies on the object. All links bend to it together, from its place of touch at
the base on, and then further by `press_part`, as far as pressures go: this presses (ADR 0095).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from soro_core.arrays import Array
from soro_core.control.laws.protocol import ArmBelief, Law, LawOptions, Preview, Setting, Terms
from soro_core.control.reference.trajectory import smooth_step


class WrapOptions(LawOptions):
    """Keys of the law."""

    bend_s: float = Field(2.0, gt=0, le=600, description="time to bend, and to press [s]")
    press_part: float = Field(
        1.0,
        ge=0,
        le=10,
        description="how much further than the reference the arm bends to press, in parts of it",
    )


@dataclass(frozen=True)
class WrapState:
    """Shape at the start (n_q,), None before it, and the time since then [s]."""

    start: Array | None = None
    time_s: float = 0.0


class Wrap(Law[WrapState]):
    """Lays the arm on an object, and presses; without feedback."""

    Options = WrapOptions

    def __init__(self, setting: Setting, options: LawOptions) -> None:
        assert isinstance(options, WrapOptions)
        self.setting, self.options = setting, options
        self.bends = setting.fields.of("bending_x") + setting.fields.of("bending_y")

    def initial_state(self) -> WrapState:
        """Return the state before the first tick."""
        return WrapState()

    def step(
        self, state: WrapState, belief: ArmBelief, reference: Preview, dt: float
    ) -> tuple[WrapState, Array, Terms]:
        """Return state, force and terms; parameters as in `Law.step`."""
        arm, start = self.setting.arm, belief.q if state.start is None else state.start
        time_s, laid = state.time_s + reference.ahead_s, reference.ahead.q
        lies = smooth_step(time_s / self.options.bend_s)[0]
        presses = self.options.press_part * smooth_step(time_s / self.options.bend_s - 1.0)[0]
        q = start + lies * (laid - start) + presses * self.bends * laid
        model = np.asarray(arm.gravity_force(q) + arm.elastic_force(q))
        return WrapState(start, state.time_s + dt), model, {"model": model}

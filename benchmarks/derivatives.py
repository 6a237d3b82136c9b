"""Derivatives of the forward dynamics and of a step: their cost in calls of what they are derivatives of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks import kernels, peer, rod
from benchmarks.options import Options
from benchmarks.report import figure, met, table
from benchmarks.timing import per_call
from soro_core import SoftArm
from soro_core.arrays import Array
from soro_core.integrate import State, make_stepper

TITLE = "Derivatives"
# Forward dynamics and derivatives together, of one call of the forward dynamics, by links.
LIMIT = {1: 4.0, 2: 4.0, 4: 8.0, 8: 8.0}
STEPPERS = ("trapezoidal", "midpoint", "tr_bdf2")
STEP_S = 1e-3
# Of the states, which a step of that length must resolve.
CALM = 0.05


@dataclass(frozen=True)
class Measured:
    """Of one number of links, seconds a call."""

    links: int
    loop: dict[str, float]
    """`forward`, `derivatives` (without the forward dynamics), `peer`."""
    python: dict[str, float]
    """`forward`, `derivatives`, and of each stepper its step and the derivatives of it."""
    difference: float
    """Largest difference from the peer's, of the largest entry; NaN without it."""


def run(options: Options) -> str:
    """Measure and write."""
    return text([measure(n, options) for n in options.pick((1, 2, 4, 8), (1, 2))], options.peer)


def measure(n: int, options: Options) -> Measured:
    """Times with n links."""
    options.say(f"{n} links")
    arm = SoftArm(rod.robot(n, rod.ANY))
    q, qd = rod.states(n)
    loops = {
        "forward": kernels.in_a_loop(arm, q, qd),
        "derivatives": kernels.derivatives_in_a_loop(arm, q, qd),
    }
    pythons = {
        "forward": kernels.from_python(arm, q, qd),
        "derivatives": kernels.from_python(arm, q, qd, arm.derivatives),
    }
    for name in options.pick(STEPPERS, STEPPERS[:1]):
        pythons[name], pythons[f"{name}, derived"] = stepping(arm, name, CALM * q, CALM * qd)
    difference = np.nan
    if options.peer:
        model = peer.make(n, rod.ANY)
        loops["peer"] = peer.derivatives_in_a_loop(model, q, qd)
        theirs = peer.derivatives(peer.differentiated(model), q, qd)
        same = SoftArm(arm.robot, nodes=peer.DEFAULT_GAUSS_POINTS)
        ours = np.array([same.derivatives(a, b, np.zeros(arm.n_u))[:2] for a, b in zip(q, qd, strict=True)])
        sizes = np.abs(theirs).max(axis=(2, 3))
        difference = float((np.abs(ours - theirs).max(axis=(2, 3)) / sizes).max())
    return Measured(n, per_call(loops, options.repeats), per_call(pythons, options.repeats), difference)


def stepping(arm: SoftArm, name: str, q: Array, qd: Array) -> tuple[Callable[[int], None], ...]:
    """Run of n steps, and of n steps with their derivatives."""
    stepper = make_stepper(name, arm, guarded=False)
    states = [State(a, b) for a, b in zip(q, qd, strict=True)]
    p = np.zeros(arm.n_u)

    def runs(call: Callable[..., object]) -> Callable[[int], None]:
        def run(n: int) -> None:
            for i in range(n):
                call(states[i % len(states)], p, STEP_S)

        return run

    return runs(stepper.step), runs(stepper.derivatives)


def row(one: Measured) -> list[object]:
    """Row of the table of derivatives."""
    forward, own = one.loop["forward"], one.loop["forward"] + one.loop["derivatives"]
    ratio, limit, python = own / forward, LIMIT[one.links], one.python["derivatives"]
    cells = [one.links, figure(1e6 * forward), figure(1e6 * own), figure(ratio)]
    cells += [f"{limit:g} ({met(ratio <= limit)})"]
    cells += [figure(1e6 * python), figure(python / one.python["forward"])]
    if "peer" not in one.loop:
        return [*cells, "-", "-", "-"]
    theirs = one.loop["peer"]
    return [*cells, figure(1e6 * theirs), figure(theirs / own), figure(one.difference, 2)]


def step_row(one: Measured) -> list[object]:
    """Row of the table of steps."""
    cells: list[object] = [one.links]
    for name in STEPPERS:
        if name in one.python:
            step, derived = one.python[name], one.python[f"{name}, derived"]
            cells.append(f"{figure(1e6 * step)} / {figure(1e6 * derived)} ({figure(derived / step, 2)})")
        else:
            cells.append("-")
    return cells


def text(rows: list[Measured], full: bool) -> str:
    """Markdown of the section."""
    head = ["links", "forward dynamics, us", "with derivatives, us", "ratio", "to reach"]
    head += ["from Python, us", "ratio", "soromox, us", "soromox / ours", "difference of the two"]
    return "\n\n".join(
        [
            "The rod and the states of the forward dynamics. Derivatives of the acceleration by q, qd and p, "
            "with the forward dynamics that they need, in a compiled loop; then `SoftArm.derivatives` and "
            "`SoftArm.forward_dynamics`, both from Python. Of soromox: `jacfwd` of its forward dynamics by "
            f"its state, in a compiled loop. {'' if full else peer.MISSING}",
            table(head, [row(one) for one in rows]),
            "The difference is the largest over the states, of the largest entry of each matrix, ours with "
            f"{peer.DEFAULT_GAUSS_POINTS} nodes a link, the default of soromox.",
            f"A step of {1e3 * STEP_S:g} ms / with its derivatives, us, from Python (ratio), with "
            "`guarded=False`:",
            table(["links", *STEPPERS], [step_row(one) for one in rows]),
        ]
    )

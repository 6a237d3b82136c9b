"""Forward dynamics: its cost against the number of links, and the accuracy of its quadrature."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks import kernels, peer, pictures, rod
from benchmarks.options import Options
from benchmarks.report import figure, met, table
from benchmarks.timing import per_call
from soro_core import SoftArm
from soro_core.arrays import Array

TITLE = "Forward dynamics"
# Microseconds to reach, and how many times faster than the peer.
LOOP_US = {1: 1.5, 2: 3.0, 4: 7.0, 8: 16.0, 16: 35.0, 32: 75.0}
PYTHON_US = {1: 5.0, 2: 7.0, 4: 11.0, 8: 17.0, 16: 35.0, 32: 80.0}
LOOP_RATIO, PYTHON_RATIO = 5.0, 8.0
FINE_NODES = 16
POINTS = peer.DEFAULT_GAUSS_POINTS


@dataclass(frozen=True)
class Measured:
    """Of one number of links."""

    links: int
    nodes: int
    loop: dict[str, float]
    """Seconds a call: `ours`, `same` (with the peer's number of nodes), `peer`."""
    python: dict[str, float]
    """`ours`, `peer`."""
    errors: list[float]
    """Ours; with the peer's nodes: ours, the peer, the peer against ours."""


def run(options: Options) -> str:
    """Measure and write."""
    all_of_them = [measure(n, options) for n in options.pick((1, 2, 4, 8, 16, 32), (1, 2))]
    links = [one.links for one in all_of_them]
    curves = {"ours, loop": [one.loop["ours"] for one in all_of_them]}
    curves["ours, Python"] = [one.python["ours"] for one in all_of_them]
    if options.peer:
        curves["soromox, loop"] = [one.loop["peer"] for one in all_of_them]
        curves["soromox, Python"] = [one.python["peer"] for one in all_of_them]
    pictures.forward(options.folder / "forward.png", links, curves)
    return text(all_of_them, options.peer)


def measure(n: int, options: Options) -> Measured:
    """Times and errors with n links."""
    options.say(f"{n} links")
    robot = rod.robot(n, rod.ANY)
    arm, same, fine = (SoftArm(robot, nodes=nodes) for nodes in (None, POINTS, FINE_NODES))
    q, qd = rod.states(n)
    exact = accelerations(fine, q, qd)
    loops = {"ours": kernels.in_a_loop(arm, q, qd), "same": kernels.in_a_loop(same, q, qd)}
    pythons = {"ours": kernels.from_python(arm, q, qd)}
    errors = [distance(accelerations(arm, q, qd), exact)]
    if options.peer:
        model = peer.make(n, rod.ANY)
        loops["constant"] = peer.in_a_loop(model, q, qd, as_argument=False)
        # The two forms differ by up to 15 per cent with few links, and not with many.
        if n <= 8:
            loops["argument"] = peer.in_a_loop(model, q, qd, as_argument=True)
        call = peer.compiled(model)
        pythons["peer"] = peer.from_python(call, q, qd)
        ours, theirs = accelerations(same, q, qd), peer.accelerations(call, q, qd)
        errors += [distance(ours, exact), distance(theirs, exact), distance(theirs, ours)]
    times = per_call(loops, options.repeats)
    forms = [times.pop(name) for name in ("constant", "argument") if name in times]
    if forms:
        times["peer"] = min(forms)
    return Measured(n, arm.nodes, times, per_call(pythons, options.repeats), errors)


def accelerations(arm: SoftArm, q: Array, qd: Array) -> Array:
    """Accelerations at each state, (count, n_q)."""
    return np.array([arm.forward_dynamics(a, b, np.zeros(arm.n_u)) for a, b in zip(q, qd, strict=True)])


def distance(a: Array, b: Array) -> float:
    """Largest relative difference of accelerations over the states, curvatures made strains by the length."""
    scale = np.tile([1.0, rod.LENGTH, rod.LENGTH], a.shape[1] // 3)
    return float((np.linalg.norm((a - b) * scale, axis=1) / np.linalg.norm(b * scale, axis=1)).max())


def compared(
    one: Measured, times: dict[str, float], limit_us: dict[int, float], limit_ratio: float
) -> list[object]:
    """Cells: links, ours, to reach, peer's, ratio."""
    own = times["ours"]
    limit = limit_us[one.links]
    cells: list[object] = [one.links, figure(1e6 * own), f"{limit:g} ({met(1e6 * own <= limit)})"]
    if "peer" not in times:
        return [*cells, "-", "-"]
    ratio = times["peer"] / own
    return [*cells, figure(1e6 * times["peer"]), f"{figure(ratio)} ({met(ratio >= limit_ratio)})"]


def loop_row(one: Measured) -> list[object]:
    """Row of the table of compiled loops."""
    same = one.loop["same"]
    ratio = figure(one.loop["peer"] / same) if "peer" in one.loop else "-"
    return [*compared(one, one.loop, LOOP_US, LOOP_RATIO), figure(1e6 * same), ratio]


def text(rows: Sequence[Measured], full: bool) -> str:
    """Markdown of the section."""
    head: Callable[[float], list[str]] = lambda ratio: [  # noqa: E731
        "links",
        "ours, us",
        "to reach, us",
        "soromox, us",
        f"soromox / ours (to reach {ratio:g})",
    ]
    accuracy = ["links", "our nodes a link", "our error"]
    if full:
        accuracy += [f"our error, {POINTS} nodes", f"soromox's, {POINTS}", "difference of the two"]
    return "\n\n".join(
        [
            "Three strains a link (elongation, two bendings), round viscous rod, 64 random states, the same "
            f"for both. {'' if full else peer.MISSING}",
            "In a compiled loop, each call depending on the one before; of soromox the faster of two forms "
            "(model as a constant or as an argument). Default quadrature of each; then ours with "
            f"{POINTS} nodes a link, the default of soromox:",
            table(
                [*head(LOOP_RATIO), f"ours with {POINTS} nodes, us", "soromox / that"],
                [loop_row(one) for one in rows],
            ),
            "From Python: `SoftArm.forward_dynamics`; a jitted function of device arrays with "
            "`block_until_ready`:",
            table(head(PYTHON_RATIO), [compared(one, one.python, PYTHON_US, PYTHON_RATIO) for one in rows]),
            f"Accelerations against those of our {FINE_NODES} nodes a link, largest relative error over the "
            "states:",
            table(accuracy, [[one.links, one.nodes, *(figure(e, 2) for e in one.errors)] for one in rows]),
            "![time against the number of links](forward.png)",
        ]
    )

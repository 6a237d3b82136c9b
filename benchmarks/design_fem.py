"""Parts of section `design` on finite elements: cases of tests/soro_design/fem."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np

from benchmarks.options import Options
from benchmarks.report import figure, table
from soro_design.fem import Contact
from tests.soro_design.fem import closed_forms as closed
from tests.soro_design.fem import moving_parts as moving
from tests.soro_design.fem.three_bellow import THESIS, forces

HEAD = ["case", "expected", "found", "off by"]


def closed_forms(options: Options) -> tuple[str, str]:
    """Thick walls, Cook's membrane, elastica, column."""
    rows = []
    for name, (radius, pressure, _) in closed.THICK.items():
        options.say(name)
        found = closed.thick_wall(name, options.pick(16, 4))
        rows.append(row(f"thick {name}, {pressure:g} mu inside: stretch of its inner radius", radius, found))
    options.say("Cook's membrane")
    rows.append(
        row("Cook's membrane, quad4 with mean dilatation", 6.9, closed.cook(options.pick(32, 4), True))
    )
    deflections = closed.elastica()[2]
    for load, found in zip(closed.ELASTICA, deflections, strict=True):
        rows.append(row(f"elastica, P L^2/EI = {load}: deflection over length", closed.ELASTICA[load], found))
    rows.append(row("column of L/h = 50: load over Euler's", 1.0, closed.euler_load()))
    return "Equilibrium against closed forms", table(HEAD, rows)


def paths_and_motion(options: Options) -> tuple[str, str]:
    """Limit points, contact, motion, modes."""
    options.say("balloon")
    stretch, load = moving.inflated()
    expected = moving.pressure_of(stretch)
    rows = [row("balloon of Neo-Hooke: greatest pressure over mu", balloon_limit(), load.max())]
    rows.append(row(f"and at a stretch of {stretch[-1]:.2f}, by arc length", expected[-1], load[-1]))
    options.say("arch")
    _, _, rise, load, peak = moving.snapped()
    worst = int(np.abs(load - moving.shallow(rise)).argmax())
    rows.append(
        row(
            "shallow arch: load over the limit, where it is furthest off",
            moving.shallow(rise[worst]) / peak,
            load[worst] / peak,
        )
    )
    options.say("modes")
    for kind, counts, slenderness in (("quad8", (30, 1), 100.0), ("hex20", (16, 1, 1), 40.0)):
        _, found, hertz = moving.cantilever_modes(kind, counts, slenderness)
        for n, (each, other) in enumerate(zip(hertz, found.frequencies_hz, strict=True), start=1):
            rows.append(row(f"cantilever, {kind}, L/h {slenderness:g}: frequency {n} [Hz]", each, other))
    for load in (-1.0, 0.5, 0.9):
        found, free = (moving.modes(*moving.pinned(at), count=1).squared[0] for at in (load, 0.0))
        rows.append(
            row(f"pinned beam at {load:g} of Euler's load: square of its frequency", 1 - load, found / free)
        )
    options.say("pendulum")
    share, drift = moving.pendulum()
    rows.append(row("pendulum from 80 degrees: period over its closed form", 1.0, share))
    rows.append(row("and how far its energy moves in 1.5 swings, over the swing", 0.0, drift))
    text = table(HEAD, rows)
    if find_spec("ipctk"):
        options.say("fold")
        text += f"\n\n{fold()}"
    return "Limit points, motion, contact", text


def fold() -> str:
    """A fold that closes under vacuum."""
    done, volume, part = moving.folded(Contact(1e-4))
    barrier = part.contact
    assert barrier is not None
    distance = np.array([barrier.distance(state.u) for state in done.states])
    meets = int(np.argmax(np.isfinite(distance)))
    stiffer = (volume[meets - 2] - volume[meets - 1]) / (volume[-2] - volume[-1])
    crossed = barrier.is_crossed(moving.folded(None)[0].last.u)
    return (
        f"A fold under vacuum: its walls come within 0.1 mm at {80 * (meets + 1)} Pa and stay"
        f" {1e6 * distance.min():.0f} um apart up to 800 Pa. There it takes {stiffer:.1f} times the pressure"
        f" for the same volume. Without contact they {'cross' if crossed else 'do not cross'}."
    )


def three_bellow_part(options: Options) -> tuple[str, str]:
    """Force against extension of the three-bellow part, both ends clamped."""
    options.say("three-bellow part")
    rows = [
        [f"{x:g}", figure(each, 4), figure(found, 4), f"{100 * (found / each - 1):+.1f} %"]
        for (x, each), found in zip(THESIS.items(), forces(), strict=True)
    ]
    return "Force of the three-bellow part", table(["mm", "thesis, N", "found, N", "off by"], rows)


def balloon_limit() -> float:
    """Greatest pressure over mu of the incompressible balloon."""
    return float(moving.pressure_of(np.linspace(1.0, 3.0, 20001)).max())


def row(name: str, expected: float, found: float) -> list[object]:
    """A case, with how far it is off: as a share, where what is expected is not 0."""
    off = f"{found / expected - 1:+.1e}" if expected else f"{found:.1e}"
    return [name, f"{expected:.5g}", f"{found:.5g}", off]

"""The table of extremes: every cell with what must happen, stated before anything is run.

Must finish, with the default stepper: steps up to 5 ms, 10 kPa to 100 MPa, up to 16 links, any curvature.
The rest may stop early, with a status that names cause and remedy.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import product

from soro_core.integrate.stepper import DISSIPATIVE
from tests.apparatus.extremes.arms import Arm
from tests.apparatus.extremes.bad_input import BAD, IN_THE_RUN, PLACES, BadInput
from tests.apparatus.extremes.cell import Cell, Must
from tests.apparatus.extremes.measure import Acceleration, Hours, Release, Seams, Straight, Swing

KPA, MPA = 1e3, 1e6
MODULI = (10 * KPA, 1 * MPA, 100 * MPA)
STEPS = (1e-5, 1e-3, 5e-3, 20e-3)
LINKS = (1, 2, 4, 8, 16, 32)
TURNS = (0.0, 0.05, 0.5, 1.0, 2.0)
METHODS = ("exact", "mde")
# A twentieth of the modulus over a radian per second of 1 kHz: rubber.
RUBBER_S = 1e-3


def cells() -> list[Cell]:
    """Every cell of the arm alone, in the order of the table."""
    return [
        *_straight(),
        *_accelerations(),
        *_grid(),
        *_dissipative(),
        *_sizes(),
        *_loads(),
        *_long(),
        *_bad_inputs(),
    ]


def _straight() -> Iterator[Cell]:
    """Values and derivatives of the forward dynamics as the curvature vanishes, and the runs from there."""
    group = "Curvature to 0"
    for curvature in (0.0, 1e-300, 1e-12, 1e-6):
        row = f"{curvature:g} 1/m"
        for method in METHODS:
            yield Cell(
                group, row, f"{method}, value and slope", Must.FINISH, Straight(Arm(2), method, curvature)
            )
        yield Cell(group, row, "release", Must.FINISH, Release(Arm(2), curvature=curvature))
    for method in METHODS:
        yield Cell(group, "1e-8 to 10 rad a link", f"{method}, no jump", Must.FINISH, Seams(Arm(2), method))


def _accelerations() -> Iterator[Cell]:
    group = "Forward dynamics alone"
    arms = {
        "10 kPa": Arm(4, 10 * KPA),
        "100 MPa": Arm(4, 100 * MPA),
        "radius 0.01 of the length": Arm(4, ratio=0.01),
        "radius 0.5 of the length": Arm(4, ratio=0.5),
        "tip mass of 100 arms": Arm(4, tip_mass=100.0),
        "1 link": Arm(1),
        "16 links": Arm(16),
        "32 links": Arm(32),
        "Legendre, order 8": Arm(2, basis="legendre", order=8),
        "Chebyshev, order 8": Arm(2, basis="chebyshev", order=8),
    }
    for (row, arm), method, turns in product(arms.items(), METHODS, (0.0, 1.0, 2.0)):
        # Twenty steps of mde cannot follow two turns; over 32 links its frames fall to pieces.
        lost = method == "mde" and arm.links == 32 and turns == 2.0
        must = Must.FINISH_OR_REFUSE if lost else Must.FINISH
        yield Cell(group, row, f"{method}, {turns:g} turns", must, Acceleration(arm, method, turns=turns))
    for method, elongation in product(METHODS, (-0.9, -1.0)):
        must = Must.FINISH if elongation > -1.0 else Must.REFUSE
        task = Acceleration(Arm(4), method, turns=0.5, elongation=elongation)
        yield Cell(group, f"elongation {elongation:g}", f"{method}, 0.5 turns", must, task)


def _grid() -> Iterator[Cell]:
    """Stiffness by step by links by curvature, without and with losses, default stepper."""
    for loss, n, modulus, turns, dt in product((0.0, RUBBER_S), (1, 4, 16, 32), MODULI, TURNS, STEPS):
        group = f"Release, {'rubber' if loss else 'no losses'}, {n} links"
        # Stiffest, most bent and without losses, at the longest step: the last digit of a node of the
        # quadrature decides between the two ends.
        on_edge = not loss and (n, modulus, turns, dt) == (16, max(MODULI), max(TURNS), 5e-3)
        inside = n <= 16 and dt <= 5e-3 and not on_edge
        task = Release(Arm(n, modulus, loss_s=loss), turns=turns, dt=dt, steps=100)
        quick = n in (1, 16) and turns in (0.05, 2.0) and modulus != 1 * MPA and dt in (1e-5, 5e-3)
        yield Cell(
            group,
            f"{modulus / MPA:g} MPa, {turns:g} turns a link",
            f"{1e3 * dt:g} ms",
            Must.FINISH if inside else Must.FINISH_OR_STOP,
            replace(task, steps=10) if quick else task,
            quick,
        )


def _dissipative() -> Iterator[Cell]:
    """Steppers that may gain no energy, without losses: stiffness by step by links by curvature."""
    for name, n, modulus, turns, dt in product(DISSIPATIVE, (1, 4, 16), MODULI, TURNS, STEPS[1:]):
        task = Release(Arm(n, modulus), turns=turns, dt=dt, steps=100, integrator=name)
        quick = n == 4 and turns in (0.05, 1.0) and dt == 5e-3
        yield Cell(
            f"Release, no losses, {name}, {n} links",
            f"{modulus / MPA:g} MPa, {turns:g} turns a link",
            f"{1e3 * dt:g} ms",
            Must.FINISH_OR_STOP,
            replace(task, steps=10) if quick else task,
            quick,
        )
    for name, n, dt in product(DISSIPATIVE, (1, 2), STEPS[1:]):
        task = Release(Arm(n), turns=0.1, elongation=-0.9, dt=dt, steps=20, integrator=name)
        group, row = "Release, no losses, elongation -0.9, 0.1 turns", f"{name}, {n} links"
        yield Cell(group, row, f"{1e3 * dt:g} ms", Must.FINISH_OR_STOP, task)


def _sizes() -> Iterator[Cell]:
    """Sections, links, orders, compression: a release with 5 ms."""
    group = "Release, no losses, 5 ms"
    for ratio in (0.01, 0.05, 0.2, 0.5):
        for turns in (0.1, 1.0):
            # Bent to such a strain of its surface, a link holds energy enough to crush itself, and may.
            must = Must.FINISH if 2 * math.pi * turns * ratio < 1.3 else Must.FINISH_OR_STOP
            task = Release(Arm(4, ratio=ratio), turns=turns, dt=5e-3)
            row, quick = f"radius {ratio:g} of the length", turns < 1.0
            yield Cell(group, row, f"{turns:g} turns a link", must, task, quick)
    for n, turns in product(LINKS, (0.1, 1.0)):
        must = Must.FINISH if n <= 16 else Must.FINISH_OR_STOP
        task = Release(Arm(n), turns=turns, dt=5e-3, steps=100)
        # Without losses a whole turn is thousands of steps inside each, seconds for many links.
        quick = turns < 1.0 and n <= 16
        yield Cell(group, f"{n} links", f"{turns:g} turns a link", must, task, quick)
    for basis, order, turns in product(("legendre", "chebyshev"), (1, 2, 4, 8), (0.1, 1.0)):
        task = Release(Arm(1, basis=basis, order=order), turns=turns, dt=5e-3, steps=50)
        quick = order == 2 and turns < 1.0
        yield Cell(group, f"{basis}, order {order}", f"{turns:g} turns a link", Must.FINISH, task, quick)
    for basis in ("legendre", "chebyshev"):
        task = Release(Arm(1, basis=basis, order=8, loss_s=RUBBER_S), turns=0.1, dt=5e-3, steps=20)
        yield Cell("Release, rubber, 5 ms", f"{basis}, order 8", "0.1 turns a link", Must.FINISH, task)
    yield from _compressed()


def _compressed() -> Iterator[Cell]:
    """Let go from a compressed or stretched state, 5 ms.

    Stretched to four times its length, a linear spring swings back beyond nothing; and of two links at -0.9
    without losses one takes energy enough from the other to do so, in truth as well.
    """
    group = "Release, stretched, 5 ms"
    musts = {-0.5: Must.FINISH, -0.9: Must.FINISH, -1.0: Must.REFUSE, 3.0: Must.FINISH_OR_STOP}
    one, two = Arm(1), Arm(2, loss_s=RUBBER_S)
    for elongation, must in musts.items():
        row = f"elongation {elongation:g}"
        for column, arm, turns in (
            ("1 link, no losses, 0.1 turns", one, 0.1),
            ("2 links, rubber, 0.1 turns", two, 0.1),
            ("2 links, rubber, 1 turn each", two, 1.0),
        ):
            task = Release(arm, turns=turns, elongation=elongation, dt=5e-3)
            yield Cell(group, row, column, must, task)
        if must is not Must.REFUSE:
            task = Release(replace(two, loss_s=0.0), turns=0.1, elongation=elongation, dt=5e-3)
            yield Cell(group, row, "2 links, no losses, 0.1 turns", Must.FINISH_OR_STOP, task, quick=False)


def _loads() -> Iterator[Cell]:
    """Rest under weights and pressures; what has no equilibrium must say so."""
    group = "To rest, 5 ms"
    # Thick and short, with as much loss as it takes to be at rest in time.
    short = Arm(2, loss_s=0.05, length=0.02, ratio=0.4)
    for modulus, mass in product(MODULI, (0.0, 1.0, 100.0)):
        arm = replace(short, youngs_modulus=modulus, tip_mass=mass)
        # The swing of the heaviest takes many minutes to die out.
        turns = 0.05 if mass < 100.0 else 0.0
        task = Release(arm, turns=turns, dt=5e-3, steps=4000, settles=True)
        yield Cell(group, f"{modulus / MPA:g} MPa", f"tip mass of {mass:g} arms", Must.FINISH, task)
    for modulus, scale in product(MODULI, (0.1, 1.0)):
        task = Release(
            replace(short, links=4, youngs_modulus=modulus), pressure=scale, dt=5e-3, steps=4000, settles=True
        )
        yield Cell(group, f"{modulus / MPA:g} MPa", f"{scale:g} of full pressure", Must.FINISH, task)
    group = "No rest to be found, 5 ms"
    sucked = Arm(1, 10 * KPA, loss_s=0.05)
    yield Cell(group, "10 kPa", "chambers sucked shut", Must.STOP, Release(sucked, pressure=-15.0, dt=5e-3))
    bursting = Arm(1, 10 * KPA, loss_s=0.05, area_slope=20.0)
    yield Cell(
        group, "10 kPa", "area that grows with strain", Must.STOP, Release(bursting, pressure=1.0, dt=5e-3)
    )
    crushed = Arm(1, 10 * KPA, loss_s=0.05, tip_mass=100.0, upright=True)
    yield Cell(group, "10 kPa", "crushed by 100 arms", Must.STOP, Release(crushed, dt=5e-3))


def _long() -> Iterator[Cell]:
    """Simulated time; the tests run a minute of it, `python -m tests.apparatus` the hour."""
    group = "Long runs"
    driven = Arm(1, 0.3 * MPA, loss_s=0.01)
    free = Release(Arm(1, 0.3 * MPA), turns=0.05)
    for name, duration, quick in (("1 min", 60.0, True), ("1 h", 3600.0, False)):
        yield Cell(group, name, "driven, 5 ms", Must.FINISH, Hours(driven, duration), quick)
        for integrator in ("trapezoidal",):
            task = Swing(replace(free, dt=1e-3, steps=round(duration / 1e-3), integrator=integrator))
            yield Cell(group, name, f"free, {integrator}, 1 ms", Must.FINISH, task, quick)


def _bad_inputs() -> Iterator[Cell]:
    for place, value in product(PLACES, BAD):
        must = Must.STOP if place in IN_THE_RUN else Must.REFUSE
        yield Cell("Input that is not a number", place, f"{value:g}", must, BadInput(place, value))

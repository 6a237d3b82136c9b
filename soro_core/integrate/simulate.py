"""Simulation of an arm with fixed steps in a compiled loop."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial, wraps
from typing import TYPE_CHECKING, ParamSpec, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from soro_core.arrays import Array, Flags
from soro_core.errors import ModelError, short
from soro_core.integrate.air import air_behind, air_pressures, initial_air
from soro_core.integrate.base_motion import Base, base_rows, moved
from soro_core.integrate.causes import BY_LOAD, describe_at
from soro_core.integrate.state import State, Status
from soro_core.integrate.stepper import internal_states, run_of, stepping
from soro_core.model import SoftArm
from soro_core.model.checks import finite, flat_wrench, note_range, number, refuse_push, require, shaped
from soro_core.model.dynamics import GOOD
from soro_core.model.equilibrium.statics import carried_share
from soro_core.pneumatics.chamber import Gas
from soro_core.pneumatics.valve_model import ValveModel

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

P = ParamSpec("P")
Wrench: TypeAlias = Callable[[float, State], ArrayLike] | ArrayLike | None
# Lines of a panel that a legend names, and their styles by the kind of coordinate where there are more.
MOST_LABELS, STYLES = 8, ("-", "--", ":", "-.")
# Largest number of values in a run, 8 GB.
MOST_NUMBERS = 1_000_000_000


@dataclass(frozen=True, repr=False)
class Result:
    """A simulated run; a failed one ends at its last good state.

    Attributes
    ----------
    t : (n_t,)
        Time [s], 0 included.
    q, qd : (n_t, n_q)
        Coordinates and velocities.
    internal : (n_t, n_internal)
        States of creep and hysteresis.
    pressure : (n_t, n_u)
        Gauge pressures of the chambers [Pa], then tensions of the tendons [N].
    status : Status
        ``ok``, or what failed, when, and what to do.
    arm : SoftArm
        The arm.
    base : (n_t, 24), optional
        Motion of a base that moves: its rotation in the world, row by row, its position, twist, and rate.
    """

    t: Array
    q: Array
    qd: Array
    internal: Array
    pressure: Array
    status: Status
    arm: SoftArm
    base: Array | None = None

    def __repr__(self) -> str:
        name, n = self.arm.robot.name, self.q.shape[1]
        return f"Result({name}: {len(self.t)} times to {self.t[-1]:.6g} s, {n} coordinates, {self.status})"

    @property
    def tip(self) -> Array:
        """Positions of the tip in the world (n_t, 3) [m]."""
        poses = self.arm.poses(self.q, self.arm.length)
        return (poses if self.base is None else moved(self.arm, self.base, poses))[:, :3, 3]

    def plot(self) -> Figure:
        """Return a figure of the tip's way from its first place, coordinates and inputs over time.

        Where a panel has many lines, its legend names some of the links, which share a colour each.
        """
        from matplotlib.figure import Figure  # loaded late: most runs are not drawn

        robot, tip = self.arm.robot, 1e3 * self.tip
        stretch = np.array(
            [not name.split("/")[1].startswith(("bending", "torsion")) for name in robot.coordinate_names]
        )
        panels = [
            ("tip moves, mm", tip - tip[0], ("x", "y", "z")),
            ("bending, torsion, 1/m", self.q[:, ~stretch], _named(robot.coordinate_names, ~stretch)),
            ("elongation, shear", self.q[:, stretch], _named(robot.coordinate_names, stretch)),
            ("pressure, kPa", 1e-3 * self.pressure[:, : len(robot.chamber_names)], robot.chamber_names),
            ("tension, N", self.pressure[:, len(robot.chamber_names) :], robot.tendon_names),
        ]
        panels = [panel for panel in panels if panel[2]]
        figure = Figure(figsize=(9.0, 2.0 * len(panels)), layout="constrained")
        for axes, (label, rows, names) in zip(figure.subplots(len(panels), sharex=True), panels, strict=True):
            _draw(axes, self.t, rows, names)
            axes.set_ylabel(label)
            axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize="small", borderaxespad=0.0)
        axes.set_xlabel("time, s")
        return figure


def _noted(run: Callable[P, Result]) -> Callable[P, Result]:
    """Log inputs beyond the range of their robot, after a run."""

    @wraps(run)
    def noted(*args: P.args, **options: P.kwargs) -> Result:
        result = run(*args, **options)
        note_range(result.arm.robot, result.pressure, "simulate")
        return result

    return noted


@_noted
def simulate(
    arm: SoftArm,
    q0: ArrayLike | None = None,
    qd0: ArrayLike | None = None,
    *,
    t_end: float = 1.0,
    dt: float = 2e-3,
    integrator: str = "trapezoidal",
    pressure: Callable[[float], ArrayLike] | ArrayLike | None = None,
    tension: Callable[[float], ArrayLike] | ArrayLike | None = None,
    wrench: Wrench = None,
    base: Base | None = None,
    valves: ValveModel | None = None,
    pressure0: ArrayLike | None = None,
    internal0: ArrayLike | None = None,
    rtol: float | None = None,
) -> Result:
    """Simulate an arm with its creep and hysteresis.

    Parameters
    ----------
    arm : SoftArm
        Model.
    q0, qd0 : (n_q,), optional
        Initial state; default straight and at rest.
    t_end, dt : float
        Duration and time step [s]; the last step is shorter if dt does not divide t_end.
    integrator : str
        One of `soro_core.integrate.STEPPERS`; docs/adr/0009 compares them.
    pressure : callable, (n_u,) or (n_t, 3, n_u), optional
        Gauge pressures [Pa], with valves their set points: a function of time, constant, or given at the
        start, the middle and the end of every step (the last row is not used); default 0. Without `tension`
        the tensions of tendons stand behind the pressures.
    tension : callable, (n_tendons,) or (n_t, 3, n_tendons), optional
        Tensions of the tendons [N], 0 or more, likewise; `pressure` is then that of the chambers alone.
    wrench : callable, (6,) or (n_wrenches, 6), optional
        Wrenches as in `SoftArm.forward_dynamics`, constant or a function of the time [s] and the `State` (q,
        qd, internal). It is called once a step, with the middle of the step: its time, q and qd extrapolated
        to there, and internal states of the start. Its value is held over the step. The error is of second
        order in dt; a stiff force that follows the arm needs a dt below its own time (ADR 0065).
    base : callable, optional
        Motion of the base: its `BaseState` as a function of time, as a `Shake`; default at rest. The
        coordinates are those seen from the base. Not with `valves`.
    valves : ValveModel, optional
        Proportional valves on all chambers: the mass of air in each is then a state, and its pressure follows
        from mass and volume (implicit integrators only).
    pressure0 : (n_u,), optional
        With valves, gauge pressures at the start [Pa]; default 0.
    internal0 : (n_internal,), optional
        Initial states of creep and hysteresis; default 0.
    rtol : float, optional
        Relative tolerance of steppers with error control (dopri5), which divide each dt as needed; default
        1e-6.

    Returns
    -------
    Result
        The run; it ends early with a status if a step fails, and never holds NaN.

    Raises
    ------
    ModelError
        If a shape, q0, qd0, t_end, dt, rtol or the integrator is not allowed.

    Notes
    -----
    A line in the log of soro_core, once a process for an arm, names pressures that are beyond
    `pressure_range_pa` of the robot, and tensions beyond `max_tension_n` of their tendon, by more than a
    twentieth of the range.
    """
    require(arm, SoftArm, "arm", "a SoftArm")
    require(valves, ValveModel | None, "valves", "a ValveModel")
    air = air_behind(arm, valves)
    run = run_of(integrator, rtol, air)
    name = arm.robot.name
    n_z = internal_states(arm, air)
    times = step_times(t_end, dt, MOST_NUMBERS // (1 + 2 * arm.n_q + n_z + 3 * arm.n_u))
    q = np.empty((len(times), arm.n_q))
    v = np.empty_like(q)
    z = np.empty((len(times), n_z))
    q[0] = _initial(q0, arm.n_q, "q0", name)
    v[0] = _initial(qd0, arm.n_q, "qd0", name)
    z[0, : arm.n_internal] = _initial(internal0, arm.n_internal, "internal0", name)
    arm.damping_force(q[0], v[0])  # refuses a collapsed start
    table = input_table(
        pressure, times, arm.n_u - (0 if tension is None else len(arm.robot.tendons)), "pressure", name
    )
    if tension is not None:
        given = input_table(tension, times, len(arm.robot.tendons), "tension", name)
        table = np.concatenate((table, given), axis=2)
    refuse_push(arm.robot, table, "pressure" if tension is None else "tension")
    inputs, motion = table, None
    if base is not None:
        steps = np.stack(
            (times, times + 0.5 * np.diff(times, append=times[-1]), np.append(times[1:], times[-1])), axis=1
        )
        rows = base_rows(base, arm, steps)
        inputs, motion = np.concatenate((table, rows), axis=2), rows[:, 0]
    start = None if pressure0 is None else _initial(pressure0, arm.n_u, "pressure0", name)
    z[0, arm.n_internal :] = initial_air(air, arm, q[0], start)
    box = stepping(arm, air, base)
    if callable(wrench):
        last, code, held = _run_pushed(partial(run, box), wrench, (times, inputs), (q, v, z), arm)
    else:
        w = finite(flat_wrench(arm.robot, wrench), "wrench")
        last, code, held = *run(box, (times, inputs, w), (q, v, z)), wrench
    end = last + 1
    carried = carried_share(arm, table[last, 0], held) if code in BY_LOAD else 1.0
    status = describe_at(code, arm, q[last], f" at t = {times[last]:.6g} s", carried)
    pressures = table[:end, 0] if not isinstance(air, Gas) else air_pressures(air, z[:end, arm.n_internal :])
    motion = None if motion is None else motion[:end]
    return Result(times[:end], q[:end], v[:end], z[:end, : arm.n_internal], pressures, status, arm, motion)


def _run_pushed(
    run: Callable[..., tuple[int, int]],
    wrench: Callable[[float, State], ArrayLike],
    given: tuple[Array, Array],
    rows: tuple[Array, Array, Array],
    arm: SoftArm,
) -> tuple[int, int, ArrayLike | None]:
    """Run step by step, each with the wrench of its middle; gives last good row, code and last wrench."""
    (times, inputs), (q, v, z) = given, rows
    held = None
    for k in range(len(times) - 1):
        half = 0.5 * (times[k + 1] - times[k])
        rate = v[k] + (half / (times[k] - times[k - 1]) * (v[k] - v[k - 1]) if k else 0.0)
        middle = State(q[k] + 0.5 * half * (v[k] + rate), rate, z[k, : arm.n_internal].copy())
        held = wrench(float(times[k] + half), middle)
        w = finite(flat_wrench(arm.robot, held), "wrench(t, state)")
        step = slice(k, k + 2)
        last, code = run((times[step], inputs[step], w), (q[step], v[step], z[step]))
        if last == 0:
            return k, code, held
    return len(times) - 1, GOOD, held


def _draw(axes: Axes, t: Array, rows: Array, names: Sequence[str]) -> None:
    """Draw rows (n_t, n) with labels; many get a colour for each link, or name, and a style for each kind."""
    if len(names) <= MOST_LABELS:
        for row, name in zip(rows.T, names, strict=True):
            axes.plot(t, row, label=name)
        return
    from matplotlib import colormaps

    links = [name.split("/")[0] for name in names]
    groups = names if len(set(links)) == 1 else links
    kinds = [name.split("/")[-1] for name in names]
    if len(set(kinds)) > len(STYLES):
        kinds = [re.sub(r"_?\d+$", "", kind) for kind in kinds]
    colours, styles = list(dict.fromkeys(groups)), list(dict.fromkeys(kinds))
    shown = styles if 1 < len(styles) <= len(STYLES) else []
    labelled = {colours[k] for k in np.linspace(0, len(colours) - 1, MOST_LABELS - len(shown)).astype(int)}
    for row, group, kind in zip(rows.T, groups, kinds, strict=True):
        colour = colormaps["viridis"](0.9 * colours.index(group) / max(len(colours) - 1, 1))
        style = STYLES[styles.index(kind) % len(STYLES)]
        axes.plot(t, row, style, color=colour, label=group if group in labelled else None)
        labelled.discard(group)
    for kind, style in zip(shown, STYLES, strict=False):
        axes.plot([], [], style, color="black", label=kind)


def _named(names: Sequence[str], wanted: Flags) -> tuple[str, ...]:
    return tuple(name for name, is_wanted in zip(names, wanted, strict=True) if is_wanted)


def step_times(t_end: float, dt: float, most: int) -> Array:
    """Return the times (n_t,) of a run.

    Parameters
    ----------
    t_end, dt : float
        As of `simulate` [s].
    most : int
        Largest number of steps.

    Raises
    ------
    ModelError
        If a number is not allowed.
    """
    for name, value, low in (("dt", dt, "above 0"), ("t_end", t_end, "of 0 or more")):
        x = number(value)
        if not (0.0 <= x < math.inf and (x > 0.0 or name == "t_end")):
            raise ModelError(f"{name} = {short(value)} s: allowed is a number {low}", name)
    dt, t_end = number(dt), number(t_end)
    if not t_end <= most * dt:
        raise ModelError(
            f"dt = {dt!r} s up to t_end = {t_end!r} s are {t_end / max(dt, 1e-300):.3g} steps: allowed are "
            f"{most:.3g}, what fits into memory; use a larger dt, or several runs",
            "dt",
        )
    n = int(np.ceil(t_end / dt - 1e-9))
    times: Array = np.arange(n + 1, dtype=np.float64) * dt
    times[-1] = t_end
    return times


def input_table(
    values: Callable[[float], ArrayLike] | ArrayLike | None, times: Array, n: int, name: str, whose: str
) -> Array:
    """Return inputs (n_t, 3, n) at the start, the middle and the end of every step.

    Parameters
    ----------
    values : callable, (n,) or (n_t, 3, n) or None
        As `pressure` of `simulate`.
    times : (n_t,)
        [s].
    n : int
        Number of inputs.
    name, whose : str
        Name of the argument and of the robot, for messages.

    Raises
    ------
    ModelError
        If a shape is wrong.
    """
    table = np.zeros((len(times), 3, n))
    if values is None:
        return table
    if not callable(values):
        try:
            stages = np.ndim(values) == 3
        except ValueError:  # rows of different lengths, which `shaped` refuses
            stages = False
        table[:] = shaped(values, table.shape if stages else (n,), name, whose)
        return table
    for k, time in enumerate(times):
        table[k, 0] = shaped(values(float(time)), (n,), f"{name}(t)", whose)
        if k + 1 < len(times):
            middle = float(0.5 * (time + times[k + 1]))
            table[k, 1] = shaped(values(middle), (n,), f"{name}(t)", whose)
    table[:-1, 2] = table[1:, 0]
    return table


def _initial(values: ArrayLike | None, n: int, name: str, whose: str) -> Array:
    return np.zeros(n) if values is None else finite(shaped(values, (n,), name, whose), name)

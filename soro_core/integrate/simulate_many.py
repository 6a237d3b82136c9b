"""Many simulations, of one arm or of many, on all cores."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from inspect import unwrap
from numbers import Integral
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from soro_core.arrays import Array, Flags
from soro_core.errors import ModelError, short
from soro_core.integrate.simulate import Result, simulate
from soro_core.jobs import Executor, given_or_threads, map_jobs
from soro_core.model import SoftArm
from soro_core.model.checks import dimensions, note_range, shaped
from soro_core.robot import Robot

Pressure: TypeAlias = Callable[[float], ArrayLike] | ArrayLike | None

# Of many runs one line in the log is enough, which names the run.
_simulate: Callable[..., Result] = unwrap(simulate)


class Runs(tuple[Result, ...]):
    """Runs in order, and their values in arrays; behind the end of a run that failed the arrays hold NaN."""

    __slots__ = ()

    @property
    def ok(self) -> Flags:
        """Which runs came to their end, (m,)."""
        return np.array([run.status.ok for run in self])

    @property
    def t(self) -> Array:
        """Times (n_t,) [s]."""
        return max((run.t for run in self), key=len)

    @property
    def q(self) -> Array:
        """Coordinates (m, n_t, n_q)."""
        return self._stacked(lambda run: run.q)

    @property
    def qd(self) -> Array:
        """Velocities (m, n_t, n_q)."""
        return self._stacked(lambda run: run.qd)

    @property
    def pressure(self) -> Array:
        """Gauge pressures (m, n_t, n_u) [Pa]."""
        return self._stacked(lambda run: run.pressure)

    @property
    def tip(self) -> Array:
        """Positions of the tips in the world (m, n_t, 3) [m]."""
        return self._stacked(lambda run: run.tip)

    def __repr__(self) -> str:
        return f"Runs({len(self)} runs, {int(self.ok.sum())} ok)"

    def _stacked(self, of: Callable[[Result], Array]) -> Array:
        """Arrays of all runs, each filled up to the longest."""
        rows, n = [of(run) for run in self], len(self.t)
        return np.stack([np.pad(row, ((0, n - len(row)), (0, 0)), constant_values=np.nan) for row in rows])


def simulate_many(
    arm: SoftArm | Sequence[SoftArm | Robot],
    q0: ArrayLike | None = None,
    qd0: ArrayLike | None = None,
    *,
    pressure: Pressure | Sequence[Callable[[float], ArrayLike]] = None,
    internal0: ArrayLike | None = None,
    cores: int | None = None,
    progress: Callable[[int, int], object] | None = None,
    executor: Executor | None = None,
    **options: Any,
) -> Runs:
    """Simulate many times; each run is that of `simulate`, whatever the number of cores.

    The runs differ in their initial state, their pressures, their arm, or all of them. By default threads do
    them: the compiled loop of a run does not hold the interpreter's lock and has a workspace of its own. A
    pressure that is a function of time is evaluated before its run, on one core at a time.

    Parameters
    ----------
    arm : SoftArm, or a sequence of m SoftArm or Robot
        Model for all runs, or for each; all with the same numbers of coordinates and inputs. An arm is
        built from each Robot.
    q0 : (m, n_q) or (n_q,), optional
        Initial coordinates, a row a run; default straight. One arm needs a row a run, here or in `pressure`.
    qd0 : (m, n_q) or (n_q,), optional
        Initial velocities; default at rest.
    pressure : callable, (n_u,), (m, n_u) or a list of m callables, optional
        Gauge pressures [Pa], with valves set points: for all runs, or for each; default 0.
    internal0 : (m, n_internal) or (n_internal,), optional
        Initial states of creep and hysteresis; default 0.
    cores : int, optional
        Number of runs at a time; default all cores that the process may use.
    progress : callable, optional
        Called in this thread after each run in order, with the numbers of runs done and of all runs.
    executor : Executor, optional
        Of `soro_core.jobs`, in place of threads: processes, which want functions of a module as pressures,
        or `executor_of(1, "tcp://host:8786")`, a Dask cluster.
    **options : Any
        The other arguments of `simulate`, for all runs.

    Returns
    -------
    Runs
        m of `Result` in order, which has their values in arrays too. A run that fails ends early, with its
        status.

    Raises
    ------
    ModelError
        If an argument is not allowed; that of one run is named by its row.
    """
    arms, m = _arms(arm), _count(arm, q0, pressure)
    first = arms[0] if isinstance(arms[0], Robot) else arms[0].robot
    name, n_q, n_u = first.name, first.n_q, first.n_u
    for k, one in enumerate(arms):
        robot = one if isinstance(one, Robot) else one.robot
        if (robot.n_q, robot.n_u) != (n_q, n_u):
            raise ModelError(
                f"arm {k}: {robot.n_q} coordinates and {robot.n_u} inputs; allowed are those of the first"
                f" one, {n_q} and {n_u}",
                "arm",
            )
    starts, rates = _rows(q0, m, n_q, "q0", name), _rows(qd0, m, n_q, "qd0", name)
    n_given = n_u if options.get("tension") is None else len(first.chamber_names)
    inputs, states = _each(pressure, m, n_given, name), [None] * m
    if internal0 is not None:
        built = SoftArm(first) if isinstance(arms[0], Robot) else arms[0]
        states = list(_rows(internal0, m, built.n_internal, "internal0", name))
    if cores is not None and (not isinstance(cores, Integral) or isinstance(cores, bool) or cores < 1):
        raise ModelError(f"cores = {short(cores)}: allowed is a whole number of 1 or more", "cores")

    jobs = (_Job(k, arms[k % len(arms)], starts[k], rates[k], inputs[k], states[k]) for k in range(m))
    done: list[Result] = []
    with (
        given_or_threads(executor, cores) as used,
        closing(map_jobs(partial(_run, options), jobs, used)) as runs,
    ):
        for run in runs:
            done.append(run)
            if progress is not None:
                progress(len(done), m)
    found = Runs(done)
    for k, result in enumerate(done):
        if note_range(result.arm.robot, result.pressure, "simulate", f" in run {k}" if m > 1 else ""):
            break
    return found


@dataclass(frozen=True)
class _Job:
    """One run."""

    number: int
    arm: SoftArm | Robot
    q0: Array
    qd0: Array
    pressure: Pressure
    internal0: Array | None


def _run(options: dict[str, Any], job: _Job) -> Result:
    try:
        arm = SoftArm(job.arm) if isinstance(job.arm, Robot) else job.arm
        return _simulate(arm, job.q0, job.qd0, pressure=job.pressure, internal0=job.internal0, **options)
    except ModelError as error:
        raise ModelError(f"run {job.number}: {error}", error.key) from None


def _arms(arm: Any) -> Sequence[SoftArm | Robot]:
    arms = [arm] if isinstance(arm, SoftArm) else list(arm) if isinstance(arm, Sequence) else []
    if not arms or isinstance(arm, str) or not all(isinstance(one, SoftArm | Robot) for one in arms):
        allowed = "a SoftArm, or a sequence of SoftArm or Robot"
        raise ModelError(f"arm: got {short(arm)}; allowed: {allowed}", "arm")
    return arms


def _count(arm: Any, q0: Any, pressure: Any) -> int:
    """Number of runs: what is given for each run says it."""
    if not isinstance(arm, SoftArm):
        return len(arm)
    if q0 is not None and dimensions(q0) == 2:
        return len(q0)
    if isinstance(pressure, Sequence) and any(callable(one) for one in pressure):
        return len(pressure)
    if pressure is not None and not callable(pressure) and dimensions(pressure) == 2:
        return len(pressure)
    if q0 is None:
        raise ModelError("q0: a row a run, (m, n_q), where neither arms nor pressures differ", "q0")
    return len(shaped(q0, (1, arm.n_q), "q0", arm.robot.name))


def _rows(values: ArrayLike | None, m: int, n: int, name: str, whose: str) -> Array:
    """Rows (m, n): those given, one for all, or 0."""
    if values is not None and dimensions(values) == 2:
        return shaped(values, (m, n), name, whose)
    return np.tile(np.zeros(n) if values is None else shaped(values, (n,), name, whose), (m, 1))


def _each(pressure: Any, m: int, n_u: int, whose: str) -> Sequence[Pressure]:
    """Return the argument `pressure` of `simulate` for each run."""
    if isinstance(pressure, Sequence) and any(callable(one) for one in pressure):
        if len(pressure) != m:
            raise ModelError(f"pressure: {len(pressure)} functions, allowed are {m}, one a run", "pressure")
        return pressure
    if pressure is not None and not callable(pressure) and dimensions(pressure) == 2:
        return list(shaped(pressure, (m, n_u), "pressure", whose))
    return [pressure] * m

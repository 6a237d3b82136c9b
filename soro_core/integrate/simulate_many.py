"""Many simulations of one arm, on all cores."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from numbers import Integral
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from soro_core.arrays import Array
from soro_core.errors import ModelError, short
from soro_core.integrate.simulate import Result, simulate
from soro_core.model import SoftArm
from soro_core.model.checks import dimensions, require, shaped

Pressure: TypeAlias = Callable[[float], ArrayLike] | ArrayLike | None


def simulate_many(
    arm: SoftArm,
    q0: ArrayLike,
    qd0: ArrayLike | None = None,
    *,
    pressure: Pressure | Sequence[Callable[[float], ArrayLike]] = None,
    internal0: ArrayLike | None = None,
    cores: int | None = None,
    **options: Any,
) -> list[Result]:
    """Simulate an arm from many initial states; each run is that of `simulate`, whatever the number of cores.

    Threads share the arm: the compiled loop of a run does not hold the interpreter's lock and has a workspace
    of its own. A pressure that is a function of time is evaluated before its run, on one core at a time.

    Parameters
    ----------
    arm : SoftArm
        Model.
    q0 : (m, n_q)
        Initial coordinates, a row a run.
    qd0 : (m, n_q) or (n_q,), optional
        Initial velocities; default at rest.
    pressure : callable, (n_u,), (m, n_u) or a list of m callables, optional
        Gauge pressures [Pa], with valves set points: for all runs, or for each; default 0.
    internal0 : (m, n_internal) or (n_internal,), optional
        Initial states of creep and hysteresis; default 0.
    cores : int, optional
        Number of runs at a time; default all cores that the process may use.
    **options : Any
        The other arguments of `simulate`, for all runs.

    Returns
    -------
    list of m Result
        In the order of q0. A run that fails ends early, with its status.

    Raises
    ------
    ModelError
        If an argument is not allowed; that of one run is named by its row.
    """
    require(arm, SoftArm, "arm", "a SoftArm")
    name, m = arm.robot.name, len(q0) if dimensions(q0) == 2 else 1  # type: ignore[arg-type]
    starts = shaped(q0, (m, arm.n_q), "q0", name)
    rates, states = (
        _rows(qd0, m, arm.n_q, "qd0", name),
        _rows(internal0, m, arm.n_internal, "internal0", name),
    )
    inputs = _each(pressure, m, arm.n_u, name)
    if cores is not None and (not isinstance(cores, Integral) or isinstance(cores, bool) or cores < 1):
        raise ModelError(f"cores = {short(cores)}: allowed is a whole number of 1 or more", "cores")

    def run(k: int) -> Result:
        try:
            return simulate(arm, starts[k], rates[k], pressure=inputs[k], internal0=states[k], **options)
        except ModelError as error:
            raise ModelError(f"run {k}: {error}", error.key) from None

    with ThreadPoolExecutor(cores or _all_cores()) as pool:
        runs = [pool.submit(run, k) for k in range(m)]
        try:
            return [one.result() for one in runs]
        except ModelError:
            pool.shutdown(cancel_futures=True)
            raise


def _all_cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


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

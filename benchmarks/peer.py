"""The peer: soromox, a JAX library of soft robots. Optional; one thread, float64."""

from __future__ import annotations

import functools
import importlib.util
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import rod
from soro_core.arrays import Array

# Its default, Gauss points a link.
DEFAULT_GAUSS_POINTS = 5
MISSING = "soromox was not measured (it comes with `pip install -e '.[bench]'`): ours alone."


def available() -> bool:
    """Tell whether it can be imported."""
    return importlib.util.find_spec("soromox") is not None


@functools.cache
def jax() -> Any:
    """Return JAX, set up before its first use."""
    flags = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {flags}".strip()
    os.environ["JAX_ENABLE_X64"] = "1"
    os.environ["JAX_PLATFORMS"] = "cpu"
    import jax as module

    # Compiling takes minutes; what has been compiled before is kept, as our kernels are.
    user = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    module.config.update("jax_compilation_cache_dir", str(Path(user) / "soro" / "benchmarks-jax"))
    module.config.update("jax_persistent_cache_min_compile_time_secs", 0.05)
    return module


def make(
    n_links: int, gravity: tuple[float, float, float] = rod.HANGING, points: int = DEFAULT_GAUSS_POINTS
) -> Any:
    """Return the rod as its spatial piecewise-constant-strain model, two bendings and elongation a link."""
    jnp = jax().numpy
    from soromox.systems.components import LinkSpec
    from soromox.systems.pcs import PCS, PCSStructure

    link = LinkSpec.circular(
        length=rod.LENGTH / n_links,
        radius=rod.RADIUS,
        density=rod.DENSITY,
        young_modulus=rod.YOUNG,
        shear_modulus=rod.SHEAR,
        material_damping_coefficient=rod.VISCOSITY,
        reference_strain=(0.0, 0.0, 0.0, 1.0, 0.0, 0.0),
    )
    structure = PCSStructure(
        num_gauss_points=points,
        strain_selector=jnp.array([False, True, True, True, False, False] * n_links),
    )
    # Its local x is the tangent, ours is z: its (x, y, z) are our (z, x, y). Its own default base is turned.
    return PCS.from_links(
        [link] * n_links,
        structure=structure,
        gravity=jnp.array(gravity)[jnp.array([2, 0, 1])],
        base_pose=jnp.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]),
    )


def to_peer(q: Array) -> Array:
    """Our coordinates (elongation, bending_x, bending_y) a link as its (about y, about z, elongation)."""
    links = q.reshape(*q.shape[:-1], -1, 3)
    return np.stack([-links[..., 2], links[..., 1], links[..., 0]], axis=-1).reshape(q.shape)


def from_peer(q: Array) -> Array:
    """Inverse of `to_peer`."""
    links = np.asarray(q).reshape(*q.shape[:-1], -1, 3)
    return np.stack([links[..., 2], links[..., 1], -links[..., 0]], axis=-1).reshape(q.shape)


def states(q: Array, qd: Array) -> Any:
    """Stacked states [q, qd] in its coordinates, on its device."""
    return jax().numpy.array(np.concatenate([to_peer(q), to_peer(qd)], axis=-1))


def compiled(model: Any) -> Any:
    """Compiled function from a state to its derivative."""
    return jax().jit(lambda y: model.forward_dynamics(0.0, y))


def derivatives(call: Any, q: Array, qd: Array) -> Array:
    """Derivatives of the acceleration by q and qd at each state, (count, 2, n_q, n_q), in our coordinates."""
    n = q.shape[1]
    turn = np.array([to_peer(row) for row in np.eye(n)]).T
    parts = np.array([np.asarray(call(y)) for y in states(q, qd)])[:, n:]
    return np.stack([turn.T @ parts[:, :, :n] @ turn, turn.T @ parts[:, :, n:] @ turn], axis=1)


def differentiated(model: Any) -> Any:
    """Compiled function from a state to the derivative of `compiled`, forward mode."""
    return jax().jit(jax().jacfwd(lambda y: model.forward_dynamics(0.0, y)))


def derivatives_in_a_loop(model: Any, q: Array, qd: Array) -> Callable[[int], None]:
    """Run of n calls of `differentiated` in a compiled loop, each depending on the one before."""
    lax, jnp = jax().lax, jax().numpy
    table = states(q, qd)
    derive = jax().jacfwd(lambda y: model.forward_dynamics(0.0, y))
    size = table.shape[1]

    def repeat(n: int) -> Any:
        return lax.fori_loop(
            0, n, lambda i, last: derive(table[i % len(q)] + 1e-30 * last[-1]), jnp.zeros((size, size))
        )

    call = jax().jit(repeat)
    return lambda n: call(n).block_until_ready()


def accelerations(call: Any, q: Array, qd: Array) -> Array:
    """Accelerations at each state (count, n_q), in our coordinates; `call` is a `compiled` one."""
    return from_peer(np.array([np.asarray(call(y))[q.shape[1] :] for y in states(q, qd)]))


def in_a_loop(model: Any, q: Array, qd: Array, as_argument: bool) -> Callable[[int], None]:
    """Run of n calls in a compiled loop, each depending on the result of the one before.

    The model is either a constant of the compiled loop or its argument: which is faster depends on the size.
    """
    lax, jnp = jax().lax, jax().numpy
    table = states(q, qd)

    def repeat(n: int, given: Any) -> Any:
        used = given if as_argument else model
        start = jnp.zeros(table.shape[1])
        return lax.fori_loop(
            0, n, lambda i, last: used.forward_dynamics(0.0, table[i % len(q)] + 1e-30 * last), start
        )

    call = jax().jit(repeat)
    given = model if as_argument else None
    return lambda n: call(n, given).block_until_ready()


def from_python(call: Any, q: Array, qd: Array) -> Callable[[int], None]:
    """Run of n calls of a `compiled` function, from states that already are its own arrays."""
    rows = list(states(q, qd))

    def run(n: int) -> None:
        for i in range(n):
            call(rows[i % len(rows)]).block_until_ready()

    return run

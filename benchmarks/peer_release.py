"""The bent release by the peer: its model under explicit and implicit solvers, fixed and adaptive steps."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from benchmarks import peer, rod
from benchmarks.release import Array, Candidate, Found, Reference, fastest, first_good, judge

SAVED = 101  # states over the run; its solvers interpolate between their steps
OWN = "SemiImplicitEuler"  # the integrator that the peer brings; the others are of diffrax
# Solvers, by the largest number of links with which they are tried: with more they were far from the best.
FIXED = {OWN: 8, "Heun": 8, "Bosh3": 4, "Tsit5": 2}
ADAPTIVE = {"Bosh3": 8, "Tsit5": 2, "Dopri8": 1, "Kvaerno3": 1}
# Relative and absolute tolerances.
TOLERANCES = tuple((r, f * r) for r in (1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4) for f in (10, 1, 0.1))
FEW_TOLERANCES = ((1e-1, 1.0), (1e-1, 1e-1), (1e-2, 1e-2), (1e-3, 1e-3), (1e-4, 1e-4))


def search(reference: Reference, n_links: int, say: Callable[[str], None]) -> list[Found]:
    """Fastest good setting of each solver."""
    model = peer.make(n_links)
    found = []
    for name, most in FIXED.items():
        if n_links <= most:
            say(f"{n_links} links, soromox {name}")
            found.append(first_good(reference, fixed(model, name, n_links, reference.t_end)))
    for name, most in ADAPTIVE.items():
        if n_links <= most:
            say(f"{n_links} links, soromox {name}, adaptive")
            candidates = adaptive(model, name, n_links, reference.t_end)
            found.append(fastest(judge(reference, one) for one in candidates))
    return [one for one in found if one is not None]


def fixed(model: Any, name: str, n_links: int, t_end: float) -> Callable[[int], Candidate]:
    """Candidate by its number of fixed steps a second; compiled once."""
    run = compiled(model, name, False, t_end)

    def make(steps: int) -> Candidate:
        return candidate(
            f"{name}, fixed", f"{1e3 / steps:.3g} ms", partial(run, 1.0 / steps, 0.0), n_links, t_end
        )

    return make


def adaptive(model: Any, name: str, n_links: int, t_end: float) -> Iterator[Candidate]:
    """Candidates by tolerance; compiled once."""
    run = compiled(model, name, True, t_end)
    for rtol, atol in FEW_TOLERANCES if n_links >= 4 or name == "Kvaerno3" else TOLERANCES:
        setting = f"rtol {rtol:g}, atol {atol:g}"
        yield candidate(f"{name}, adaptive", setting, partial(run, rtol, atol), n_links, t_end)


def candidate(method: str, setting: str, call: Callable[[Any], Any], n_links: int, t_end: float) -> Candidate:
    """Candidate from a compiled run that takes the state at the start."""
    start = peer.states(rod.bent(n_links), np.zeros(3 * n_links))

    def run() -> tuple[Array, Array]:
        saved = call(start).block_until_ready()
        return np.linspace(0.0, t_end, SAVED), peer.from_peer(np.asarray(saved)[:, : 3 * n_links])

    return Candidate(method, setting, run)


def compiled(model: Any, name: str, is_adaptive: bool, t_end: float) -> Callable[..., Any]:
    """Compiled run (step or rtol, atol, state) -> saved states."""
    import diffrax
    from soromox.simulation.integrators import SemiImplicitEuler
    from soromox.systems.dynamical_system import _RolloutState as State

    jax = peer.jax()
    term = diffrax.ODETerm(lambda t, x, _: State(y=model.forward_dynamics(t, x.y)))
    solver = SemiImplicitEuler(system=model) if name == OWN else getattr(diffrax, name)()
    saveat = diffrax.SaveAt(ts=jax.numpy.linspace(0.0, t_end, SAVED))

    def run(x: Any, atol: Any, y: Any) -> Any:
        control = diffrax.PIDController(rtol=x, atol=atol) if is_adaptive else diffrax.ConstantStepSize()
        options = {"saveat": saveat, "stepsize_controller": control, "max_steps": None, "throw": False}
        step = None if is_adaptive else x
        return diffrax.diffeqsolve(term, solver, 0.0, t_end, step, State(y=y), **options).ys.y

    return jax.jit(run)

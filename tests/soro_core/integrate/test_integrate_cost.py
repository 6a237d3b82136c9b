"""What a step costs, counted, and what is compiled for whom."""

import os
import subprocess
import sys

import pytest

pytestmark = pytest.mark.process

COUNT = """
import sys
sys.path.insert(0, {folder!r})
from rods import bent, rod
from soro_core import simulate
from soro_core.integrate import newton

counts = dict(force_residual=0, factor=0)
def counted(name, function):
    def wrapper(*args):
        counts[name] += 1
        return function(*args)
    return wrapper
for name in counts:
    setattr(newton, name, counted(name, getattr(newton, name)))
arm = rod(1, 1e5, 30.0)
print(simulate(arm, bent(arm), t_end=20 * 2e-3, dt=2e-3, integrator={name!r}).status)
print(counts["force_residual"], counts["factor"])
"""

COMPILED = """
import sys
sys.path.insert(0, {folder!r})
from rods import IMPLICIT, rod
from soro_core.integrate import make_stepper
from soro_core.integrate.explicit import explicit_run
from soro_core.integrate.implicit import implicit_run

arm = rod(2, 1e5, 30.0)
for name in IMPLICIT:
    stepper = make_stepper(name, arm)
    stepper.step(stepper.initial_state(), [], 1e-3)
print(len(implicit_run.signatures), len(explicit_run.signatures))
"""
FOLDER = os.path.dirname(__file__)


def python(code, **environment):
    done = subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, **environment}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@pytest.mark.parametrize(
    ("name", "evaluations", "factorisations"), [("midpoint_linear", 22, 20), ("tr_bdf2_linear", 42, 41)]
)
def test_linear_steppers_evaluate_and_factor_once_a_stage(name, evaluations, factorisations):
    """20 steps of the plain Python functions.

    Without a prediction, which takes two accelerations, a step evaluates twice; TR-BDF2 finds one of them at
    the start.
    """
    code = COUNT.format(folder=FOLDER, name=name)
    status, forces, factors = python(code, NUMBA_DISABLE_JIT="1")
    assert status == "ok"
    assert (int(forces), int(factors)) == (evaluations, factorisations)


def test_implicit_steppers_share_one_kernel_with_the_guard_of_the_energy_and_one_without():
    """And no other is compiled."""
    assert python(COMPILED.format(folder=FOLDER)) == ["2", "0"]

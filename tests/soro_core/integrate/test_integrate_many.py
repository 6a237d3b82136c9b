"""Many simulations at a time: each is the one that `simulate` makes."""

import numpy as np
import pytest
from rods import bellows

from soro_core import simulate, simulate_many
from soro_core.errors import ModelError, SoroError
from soro_core.jobs import Processes
from tests.refused import fails

RUNS = 6


def starts(arm):
    rng = np.random.default_rng(0)
    scale = np.array([0.01, 3.0, 3.0])
    return rng.normal(size=(RUNS, 3)) * scale, rng.normal(size=(RUNS, 3)) * scale


def same(got, wanted):
    assert got.status == wanted.status
    for name in ("t", "q", "qd", "internal", "pressure"):
        np.testing.assert_array_equal(getattr(got, name), getattr(wanted, name))


@pytest.mark.parametrize("cores", [1, 2, None])
def test_each_run_has_the_same_bits_as_alone(cores):
    arm = bellows(creep=[{"tau": 0.05, "stiffness": [40.0, 2e-3, 2e-3]}])
    q, qd = starts(arm)
    p, z = np.linspace(0.0, 2e4, RUNS * 3).reshape(RUNS, 3), 0.1 * q
    options = {"t_end": 0.02, "dt": 1e-3, "integrator": "trapezoidal"}
    runs = simulate_many(arm, q, qd, pressure=p, internal0=z, cores=cores, **options)
    assert len(runs) == RUNS
    for k, run in enumerate(runs):
        same(run, simulate(arm, q[k], qd[k], pressure=p[k], internal0=z[k], **options))


@pytest.mark.slow
def test_processes_give_the_same_bits():
    q, options = starts(bellows())[0], {"t_end": 4e-3, "dt": 1e-3}
    with Processes(2) as executor:
        runs = simulate_many([bellows().robot] * RUNS, q, executor=executor, **options)
        with fails(SoroError, "cannot be sent to another process"):
            simulate_many(bellows(), q, pressure=lambda t: np.zeros(3), executor=executor, **options)
    for run, start in zip(runs, q, strict=True):
        same(run, simulate(bellows(), start, **options))


def test_robots_may_differ_in_creep():
    plain, creeping = bellows(), bellows(creep=[{"tau": 0.05, "stiffness": [40.0, 2e-3, 2e-3]}])
    options = {"pressure": [1e4, 0.0, 0.0], "t_end": 4e-3, "dt": 1e-3}
    arms = [plain, creeping, creeping.robot]
    for run, arm in zip(simulate_many(arms, **options), (plain, creeping, creeping), strict=True):
        same(run, simulate(arm, **options))


def test_one_input_for_all_runs_or_one_function_each():
    arm = bellows()
    q, _ = starts(arm)
    options = {"t_end": 4e-3, "dt": 1e-3}

    def wave(phase):
        return lambda t: [1e4 * np.sin(100.0 * t + phase) ** 2, 0.0, 5e3]

    for given, alone in (
        (None, [None] * RUNS),
        ([1e3, 2e3, 3e3], [[1e3, 2e3, 3e3]] * RUNS),
        (wave(0.0), [wave(0.0)] * RUNS),
        ([wave(k) for k in range(RUNS)], [wave(k) for k in range(RUNS)]),
    ):
        for k, run in enumerate(simulate_many(arm, q, pressure=given, **options)):
            same(run, simulate(arm, q[k], pressure=alone[k], **options))


def test_a_run_that_fails_ends_alone():
    arm = bellows()
    p = np.array([[0.0] * 3, [-1e6] * 3, [0.0] * 3])
    runs = simulate_many(arm, np.zeros((3, 3)), pressure=p, t_end=0.01, dt=1e-3)
    assert [run.status.ok for run in runs] == [True, False, True]


def test_what_is_not_allowed_is_named_with_its_run():
    arm = bellows()
    q = np.zeros((3, 3))
    with fails(ModelError, "run 1", key="q0"):
        simulate_many(arm, [[0.0, 0.0, 0.0], [np.nan, 0.0, 0.0]])
    with fails(ModelError, "(3, 2)", "(3, 3)", key="q0"):
        simulate_many(arm, q[:, :2])
    with fails(ModelError, "(3,)", "(1, 3)", key="q0"):
        simulate_many(arm, q[0])
    with fails(ModelError, "(2, 3)", "(3, 3)", key="qd0"):
        simulate_many(arm, q, q[:2])
    with fails(ModelError, "2", "3", key="pressure"):
        simulate_many(arm, q, pressure=[np.zeros, np.zeros])
    for cores in (0, 1.5, True, "all"):
        with fails(ModelError, "cores", key="cores"):
            simulate_many(arm, q, cores=cores)
    with fails(ModelError, "SoftArm", key="arm"):
        simulate_many("arm", q)

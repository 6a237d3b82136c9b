"""The workspace of the kernels: `zero` stays zero, and no result depends on what was computed before."""

import numpy as np
import pytest
from outside_arms import CASES, PLANE, arm_of, state_of

from soro_core import SoftArm, load_robot
from soro_core._box import view
from soro_core._jit import kernel
from soro_core.model import entries
from soro_core.model.build import find_site

pytestmark = pytest.mark.slow


@kernel
def largest_zero(box):
    """Largest entry of the row that stays zero."""
    largest = 0.0
    for x in view(box).work.zero:
        largest = max(largest, abs(x))
    return largest


def calls(arm, box, q, qd):
    """Every entry that computes in the workspace, as a function without arguments."""
    n, t = arm.n_q, arm.tables
    wrench = np.full(6 * (1 + len(arm.robot.wrench_places)), 0.01)
    site = find_site(arm.robot, t, 0.6 * arm.length)

    def inertia():
        M = np.empty((n, n))
        entries.inertia_matrix(box, q, M)
        return M

    def inertial():
        v, a, out = qd[None] + 1.0, qd[None] - 2.0, np.empty((1, n))
        entries.inertial_forces(box, (t.mass[None], np.full(1, 0.02), t.gravity), (q, qd, v, a), out)
        return out

    def external():
        tau, force = np.empty(n), np.empty((len(t.external.kind), 3))
        energy = entries.external_forces(box, q, qd, wrench, tau, force)
        return np.concatenate((tau, force.ravel(), [energy]))

    def kinematics():
        R, p, J = np.empty((3, 3)), np.empty(3), np.empty((n, 6))
        entries.pose_and_jacobian(box, site, q, R, p, J)
        return np.concatenate((R.ravel(), p, J.ravel()))

    def energy():
        return np.array(entries.mechanical_energy(box, q, qd))

    def acceleration():
        out = np.empty(n)
        z, pressure = np.zeros(arm.n_internal), np.full(arm.n_u, 1e3)
        assert entries.accelerations(box, (q, qd, z), pressure, wrench, out) == 0
        return out

    return [inertia, inertial, external, kinematics, energy, acceleration]


@pytest.mark.parametrize("case", [*CASES, None], ids=str)
def test_no_result_depends_on_what_was_computed_before(case):
    """`exact` with contact on links of every kind; None: the method `mde`."""
    if case is None:
        arm = SoftArm(load_robot("six_link"), method="mde")
    else:
        arm = arm_of(*case, contacts={"planes": [PLANE], "points_per_link": 4})
    q, qd = state_of(arm)
    box = entries.make_box(arm.tables)
    fresh = [calls(arm, entries.make_box(arm.tables), q, qd)[k]() for k in range(6)]
    used = calls(arm, box, q, qd)
    others = calls(arm, box, -0.3 * q, 2.0 * qd)
    for first in range(6):
        for second in range(6):
            others[first]()
            np.testing.assert_array_equal(used[second](), fresh[second])
            assert largest_zero(box) == 0.0

"""Accuracy of few coordinates against converged trajectories of a linear-elastic rod (tests/reference)."""

import json

import numpy as np
import pytest

from soro_core import SoftArm, robot_from_dict, simulate


def strains(**orders):
    return {name: {"basis": "legendre", "order": order} for name, order in orders.items()}


PLANAR_10 = strains(bending_x=3, elongation=2, shear_x=2)
PLANAR_16 = strains(bending_x=5, elongation=4, shear_x=4)
SPATIAL_10 = strains(bending_x=3, bending_y=2, elongation=2)


def tip_error(reference, case, fields):
    """RMS distance of the tip over 1 s from the reference [% of the length], and n_q."""
    with np.load(reference / f"ref_{case}.npz") as data:
        p, right = json.loads(str(data["params"])), data["tip"]
    root = np.sqrt(0.5)
    link = {
        "length": p["L"],
        "radius": p["R"],
        "density": p["RHO"],
        "strains": fields,
        "material": {"youngs_modulus": p["E"], "shear_modulus": p["G"], "viscosity": p["ETA"]},
    }
    gravity = [0.0, 0.0, -p["GRAV"]] if p["mount"] == "horiz" else [p["GRAV"], 0.0, 0.0]
    robot = {"gravity": gravity, "base_quaternion": [0.0, root, 0.0, root], "links": [link]}
    arm = SoftArm(robot_from_dict(robot))
    q0 = np.zeros(arm.n_q)
    q0[arm.robot.coordinate_names.index("link0/bending_x_0")] = p["BEND"] / p["L"]
    run = simulate(arm, q0, t_end=1.0, dt=5e-4)
    assert run.status.ok
    tip = np.array([arm.pose(q, arm.length)[:3, 3] for q in run.q[::4]])
    return 100.0 * np.sqrt(((tip - right) ** 2).sum(axis=1).mean()) / p["L"], arm.n_q


@pytest.mark.parametrize("case", ["cantilever_kv", "hang_bent_kv"])
@pytest.mark.parametrize(
    ("fields", "coordinates", "bound"),
    [(PLANAR_10, 10, 0.15), (PLANAR_16, 16, 0.03), (SPATIAL_10, 10, 1.0)],
    ids=["planar-10", "planar-16", "spatial-10"],
)
def test_few_coordinates_follow_the_rod(reference, figure, case, fields, coordinates, bound):
    error, n_q = tip_error(reference, case, fields)
    figure(f"{case}, {n_q} coordinates: tip RMSE {error:.4f} % of the length (bound {bound} %)")
    assert n_q == coordinates
    assert error <= bound

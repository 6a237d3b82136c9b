"""The loop with a model of varying strain; the plant has four links of constant strain."""

from dataclasses import replace

import numpy as np
import pytest
from loop_harness import Setup, run

from soro_core import load_robot
from soro_core.config import find_config
from soro_core.robot import robot_from_dict


@pytest.fixture(scope="module")
def robot():
    return load_robot(find_config("tue_three_bellow", "robots"))


def varying(robot, order):
    """Every strain by Legendre polynomials; losses as those of a strain that is uniform along the link."""
    data = robot.model_dump(exclude_unset=True)
    share = 1.0 / (2.0 * np.arange(order + 1) + 1.0)
    for link in data["links"]:
        link["strains"] = {
            name: {"basis": "legendre", "order": order} for name in ("elongation", "bending_x", "bending_y")
        }
        link["damping"] = np.kron(link["damping"], share).tolist()
        for branch in link["creep"]:
            branch["stiffness"] = np.kron(branch["stiffness"], share).tolist()
    return robot_from_dict(data)


def test_order_zero_runs_as_constant_strain_does(robot):
    setup = Setup(duration_s=1.5)
    constant, zero = run(robot, setup), run(varying(robot, 0), replace(setup, plant=robot))
    np.testing.assert_allclose(zero.command, constant.command, atol=1e-3)  # Pa
    np.testing.assert_allclose(zero.q, constant.q, atol=1e-7)
    np.testing.assert_allclose(zero.tip, constant.tip, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("order", [2])
def test_the_main_job_with_varying_strain(robot, figure, order):
    """As `test_the_main_job`, where constant strain leaves 0.74 mm: 20 g that no model contains."""
    record = run(varying(robot, order), Setup(plant=robot, duration_s=14.0))
    tip, estimate = 1e3 * record.rms(), 1e3 * record.estimation_rms()
    figure(f"main job, legendre order {order}: tip RMS {tip:.2f} mm, filter {estimate:.2f} mm")
    assert tip <= 0.6
    assert estimate <= 0.45
    assert not record.saturated[record.t > 5.0].any()
    assert record.counts.outliers + record.counts.failed + record.counts.reacquired == 0

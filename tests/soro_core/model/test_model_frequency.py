"""First natural frequency of the model as a clamped beam, against that of Timoshenko in closed form."""

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import brentq

from soro_core import SoftArm, robot_from_dict

LENGTH, DENSITY, FACTOR = 0.2, 1100.0, 0.9
E, G = 5e5, 5e5 / 3
SLENDERNESS = (0.01, 0.05, 0.1, 0.2, 0.3)  # radius over length


def timoshenko(radius, factor=FACTOR):
    """First frequency [rad/s] of the cantilever from its frequency equation (Huang, 1961): shear and rotary
    inertia, uniform round section. b^2 = m L^4 w^2 / EI, R2 = I / A L^2, S2 = EI / (factor G A L^2).
    """
    area, inertia = np.pi * radius**2, np.pi * radius**4 / 4
    r2, s2 = inertia / (area * LENGTH**2), E * inertia / (factor * G * area * LENGTH**2)

    def equation(b):
        root = np.sqrt((r2 - s2) ** 2 + 4 / b**2)
        low, high = b * np.sqrt((root - r2 - s2) / 2), b * np.sqrt((root + r2 + s2) / 2)
        return (
            2.0
            + (b**2 * (r2 - s2) ** 2 + 2.0) * np.cosh(low) * np.cos(high)
            - b * (r2 + s2) / np.sqrt(1.0 - b**2 * r2 * s2) * np.sinh(low) * np.sin(high)
        )

    b = brentq(equation, 0.5, 3.6, xtol=1e-14)
    return b * np.sqrt(E * inertia / (DENSITY * area)) / LENGTH**2


def model(radius, fields, n_links=1, **material):
    """First frequency [rad/s] from M and K of the straight arm without gravity."""
    link = {
        "length": LENGTH / n_links,
        "radius": radius,
        "density": DENSITY,
        "strains": fields,
        "material": {"youngs_modulus": E, "shear_modulus": G, "shear_factor": FACTOR, **material},
    }
    arm = SoftArm(robot_from_dict({"links": [link] * n_links, "gravity": [0.0, 0.0, 0.0]}))
    q = np.zeros(arm.n_q)
    first = eigh(arm.stiffness_matrix(q), arm.inertia_matrix(q), eigvals_only=True, subset_by_index=[0, 0])
    return float(np.sqrt(first[0]))


def degree(k, *names, basis="legendre"):
    return {name: {"basis": basis, "order": k} for name in names}


def test_the_closed_form_knows_the_slender_beam_and_the_reference_rod():
    """Euler and Bernoulli: b = 1.8751041^2. The rod of the reference: 2.20762 Hz at shear factor 27/28."""
    thin = 1e-4 * LENGTH
    assert timoshenko(thin) == pytest.approx(
        1.8751040687**2 * np.sqrt(E * thin**2 / 4 / DENSITY) / LENGTH**2, rel=1e-6
    )
    assert timoshenko(0.015, 27 / 28) / (2 * np.pi) == pytest.approx(2.20762, abs=2e-5)


FIELDS = {
    "shear left out, degree 2": degree(2, "bending_x"),
    "shear left out, degree 3": degree(3, "bending_x"),
    "shear left out, chebyshev, spatial, 10 coordinates": {
        **degree(3, "bending_x", basis="chebyshev"),
        **degree(2, "bending_y", "elongation", basis="chebyshev"),
    },
    "shear carried, degree 3": degree(3, "bending_x", "shear_x"),
}


@pytest.mark.parametrize("ratio", SLENDERNESS)
@pytest.mark.parametrize("name", FIELDS)
def test_first_frequency_is_that_of_timoshenko(name, ratio, figure):
    """The lowest frequency is compared: of the spatial arm that of bending_x, which has the higher degree."""
    right = timoshenko(ratio * LENGTH)
    error = 100 * (model(ratio * LENGTH, FIELDS[name]) / right - 1)
    figure(f"{name}, radius {ratio:g} of the length: first frequency {error:+.4f} % from Timoshenko")
    assert abs(error) <= 0.1
    if "degree 3" in name:
        assert abs(error) <= 0.001


@pytest.mark.parametrize("ratio", SLENDERNESS)
def test_links_of_constant_strain_need_sixteen(ratio, figure):
    right = timoshenko(ratio * LENGTH)
    errors = [100 * (model(ratio * LENGTH, {"bending_x": {}}, n) / right - 1) for n in (8, 16)]
    figure(f"8, 16 links, radius {ratio:g} of the length: {errors[0]:+.3f}, {errors[1]:+.3f} %")
    assert abs(errors[1]) <= 0.1
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)


def test_the_correction_is_what_brings_it_there():
    """Without it a thick arm is too fast by several per cent."""
    right = timoshenko(0.2 * LENGTH)
    bare = model(0.2 * LENGTH, degree(3, "bending_x"), shear_correction=False)
    assert bare / right - 1 > 0.04

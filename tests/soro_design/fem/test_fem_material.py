"""Material files: their stress, their stability, and what is refused."""

import numpy as np
import pytest

from soro_core.config import config_folder
from soro_design.fem.elements.material import (
    drucker_modulus,
    first_unstable,
    load_material,
    material_from_dict,
    nominal_stress,
)
from tests.refused import refused

# Nominal stress at stretch 2 [MPa], by hand from the constants of the presets.
AT_TWO = {
    "dragonskin_10": 0.13047,
    "dragonskin_30": 0.56000,
    "ecoflex_00_10": 0.00867,
    "ecoflex_00_30": 0.05767,
    "ecoflex_00_50": 0.05215,
    "elastic_50a": 1.8772,
    "elastosil_28": 0.66500,
    "rtv_615": 0.80395,
    "ninjaflex_85": 7.8400,
    "tpu_90": 4.3125,
}
YEOH = {"kind": "hyperelastic", "source": "a test", "c1_pa": 1e5, "poisson_ratio": 0.49}


@pytest.mark.parametrize("name", AT_TWO)
def test_stress_of_the_shipped_materials(name):
    assert nominal_stress(load_material(name), 2.0) / 1e6 == pytest.approx(AT_TWO[name], rel=1e-3)


def test_every_shipped_material_is_tested_and_has_a_source():
    files = {path.stem for path in (config_folder() / "materials").glob("*.yaml")}
    assert files == set(AT_TWO)
    assert all("SorotokiCode" in load_material(name).source for name in files)


def test_moduli_of_small_strains():
    material = load_material("tpu_90")
    assert material.shear_modulus_pa == pytest.approx(6.9e6 / 2.8)
    # E = 9 K mu / (3 K + mu)
    K, mu = material.bulk_modulus_pa, material.shear_modulus_pa
    assert 9 * K * mu / (3 * K + mu) == pytest.approx(6.9e6)
    # The slope of the stress at constant volume is 3 mu.
    assert nominal_stress(material, 1 + 1e-6) / 1e-6 == pytest.approx(3 * mu, rel=1e-5)


def test_a_softening_law_is_refused_where_it_is_not_stable():
    soft = {**YEOH, "c2_pa": -1.2e4, "stretch_range": [0.9, 1.1]}
    assert material_from_dict(soft).c2_pa == -1.2e4
    with refused("stretch_range"):
        material_from_dict({**soft, "stretch_range": [0.3, 3.0]})


def energy(material, logs):
    """Energy at constant volume of two logarithms of principal stretches."""
    stretches = np.exp([*logs, -sum(logs)])
    x = (stretches**2).sum() - 3.0
    return material.c1_pa * x + material.c2_pa * x**2


def least_curvature(material, logs, step=2e-4):
    """Least second derivative of the energy in any direction of the two logarithms, by differences."""
    units = step * np.eye(2)
    second = [
        sum(s * t * energy(material, logs + s * i + t * j) for s in (1, -1) for t in (1, -1))
        for i in units
        for j in units
    ]
    return np.linalg.eigvalsh(np.reshape(second, (2, 2)))[0] / (4 * step**2)


@pytest.mark.parametrize("pair", [(1.0, 1.0), (1.9, 0.8), (1.5, 1.5), (0.6, 1.1)])
def test_druckers_modulus_is_the_curvature_of_the_energy(pair):
    material = material_from_dict({**YEOH, "c2_pa": -1.2e4, "stretch_range": [0.9, 1.1]})
    expected = least_curvature(material, np.log(pair))
    assert drucker_modulus(material, *pair) == pytest.approx(expected, rel=1e-4)


def test_the_first_unstable_stretches_are_the_nearest():
    material = material_from_dict({**YEOH, "c2_pa": -1.2e4, "stretch_range": [0.9, 1.1]})
    a, b = first_unstable(material, 0.3, 3.0)
    assert drucker_modulus(material, a, b) <= 0.0
    # Stretches are tried 6 % apart.
    assert drucker_modulus(material, a**0.8, b**0.8) > 0.0
    assert first_unstable(material, 0.8, 1.2) is None


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"kind": "ogden"}, "kind"),
        ({"c1_pa": 0.0}, "c1_pa"),
        ({"c1_pa": -1.0}, "c1_pa"),
        ({"c4_pa": 1.0}, "c4_pa"),
        ({"poisson_ratio": 0.5}, "poisson_ratio"),
        ({"c2_pa": float("nan")}, "c2_pa"),
        ({"stretch_range": [1.1, 2.0]}, "stretch_range"),
        ({"source": ""}, "source"),
    ],
)
def test_what_is_refused(change, key):
    with refused(key):
        material_from_dict({**YEOH, **change})


def test_a_material_without_a_source_is_refused():
    with refused("source"):
        material_from_dict({key: value for key, value in YEOH.items() if key != "source"})

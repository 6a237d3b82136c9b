"""Elastomers by name: modulus at small strain and density, each with its source.

A data sheet states the stress at 100 % strain, from which the modulus follows as that of a neo-Hookean
material: stress = E / 3 (2 - 1 / 4) at twice the length. Of a Yeoh law it is 6 C1.
"""

from __future__ import annotations

from dataclasses import dataclass

from soro_core.errors import ConfigError

_PSI = 6894.757
_STRETCH = 2.0


@dataclass(frozen=True)
class NamedMaterial:
    """An elastomer.

    Attributes
    ----------
    youngs_modulus_pa : float
        At small strain [Pa].
    density_kg_m3 : float
        Cured or printed without pores [kg/m^3].
    source : str
        Where both come from.
    """

    youngs_modulus_pa: float
    density_kg_m3: float
    source: str


def _from_stress(psi: float, density: float, sheet: str) -> NamedMaterial:
    """Return the material whose stress at 100 % strain is given."""
    modulus = 3.0 * psi * _PSI / (_STRETCH - _STRETCH**-2)
    return NamedMaterial(
        modulus, density, f"100 % modulus of {psi:g} psi and density of {sheet}, neo-Hookean"
    )


_SMOOTH_ON = "Smooth-On's technical bulletin"
MATERIALS = {
    "ecoflex-0010": _from_stress(8.0, 1040.0, _SMOOTH_ON),
    "ecoflex-0030": _from_stress(10.0, 1070.0, _SMOOTH_ON),
    "ecoflex-0050": _from_stress(12.0, 1070.0, _SMOOTH_ON),
    "dragonskin-10": _from_stress(22.0, 1070.0, _SMOOTH_ON),
    "dragonskin-20": _from_stress(49.0, 1080.0, _SMOOTH_ON),
    "dragonskin-30": _from_stress(86.0, 1080.0, _SMOOTH_ON),
    "elastosil-m4601": NamedMaterial(
        6 * 0.11e6, 1130.0, "Yeoh C1 = 0.11 MPa of the Soft Robotics Toolkit; density of Wacker's data sheet"
    ),
    "tpu-85a": NamedMaterial(
        12e6, 1190.0, "tensile modulus and density of NinjaTek's data sheet of NinjaFlex"
    ),
}
# Of a silicone, for arms without a named material [kg/m^3].
DENSITY = 1070.0


def find_material(name: str) -> NamedMaterial:
    """Return a material by its name, in whatever case and with or without hyphens.

    Raises
    ------
    ConfigError
        With the names.
    """
    plain = {_plain(known): material for known, material in MATERIALS.items()}
    if _plain(name) not in plain:
        raise ConfigError("soro new", "--material", name, f"one of {', '.join(MATERIALS)}")
    return plain[_plain(name)]


def _plain(name: str) -> str:
    return "".join(sign for sign in name.lower() if sign.isalnum())

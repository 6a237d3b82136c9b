"""The link that stands for a rod or PneuNet: its unknown numbers, and the robot that they make."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from soro_core.robot import Robot, robot_from_dict
from soro_design.parts.file import PartFile
from soro_design.parts.geometry import PneunetGeometry
from soro_design.parts.specimen import RodSpecimen
from soro_design.robot_of_part.direct import Direct
from soro_lab.identification.fit import Parameter

# How far a joint fit may move what single loads give.
FORCES, AREA, ARM, SLOPE, LEVEL = 0.1, 0.4, 0.4, 20.0, 2.0
# Forces give these two, so that a bound of theirs is no fault of the link.
GIVEN = ("k_e_rest", "k_b_rest")


@dataclass(frozen=True)
class Template:
    """What is known of the link before a fit.

    Attributes
    ----------
    name : str
        Of the robot.
    length_m, radius_m, mass_kg : float
        Of the part; the radius of a round solid section of the same area.
    area_m2, second_moment_m4 : float
        Of the material of a section; of a PneuNet its mean, and that of solid rubber as stiff as it is at a
        force across.
    chambers : int
        Chambers, evenly around the axis.
    pressure_range_pa : tuple of float
        Least and greatest pressure of the sweeps, 0 among them.
    viscosity_pa_s : float
        Of the material; 0 where it is not known.
    gravity, base_quaternion : tuple of float
        Of the robot file.
    """

    name: str
    length_m: float
    radius_m: float
    mass_kg: float
    area_m2: float
    second_moment_m4: float
    chambers: int
    pressure_range_pa: tuple[float, float]
    viscosity_pa_s: float
    gravity: tuple[float, float, float]
    base_quaternion: tuple[float, ...]

    @property
    def strains(self) -> tuple[str, ...]:
        """Of the link; two chambers bend it in their plane alone, one does at the length of its layer."""
        if self.chambers == 1:
            return ("bending_x",)
        return ("elongation", "bending_x") if self.chambers == 2 else ("elongation", "bending_x", "bending_y")

    @property
    def damping(self) -> tuple[float, ...]:
        """Of its strains: 3 eta A and 3 eta I along the length, docs/model.md (20)."""
        eta_l = 3.0 * self.viscosity_pa_s * self.length_m
        own = {"elongation": self.area_m2}
        return tuple(eta_l * own.get(name, self.second_moment_m4) for name in self.strains)


def template(file: PartFile, specimen: RodSpecimen, name: str, start: Direct) -> Template:
    """Return what a part file and its mesh say of the link.

    Parameters
    ----------
    file : PartFile
    specimen : RodSpecimen
        Made of it.
    name : str
        Of the robot.
    start : Direct
        What single loads give.
    """
    rod, mesh, part = specimen.rod, specimen.part.mesh, specimen.part
    section, length = mesh.points[rod.sections[0]], float(np.ptp(specimen.z))
    if isinstance(file.geometry, PneunetGeometry):
        # Its walls fold, so that no section says how much rubber bends.
        area = float(part.volume.sum()) / length
        second_moment = start.k_b_nm * length / (3.0 * part.material.shear_modulus_pa)
    else:
        # Of a tapered rod, the section in the middle.
        size = float(np.ptp(mesh.points[rod.sections[len(rod.sections) // 2], 0]) / np.ptp(section[:, 0]))
        area = float(rod.share.sum()) * size**2
        second_moment = float(rod.share @ section[:, 0] ** 2) * size**4
    pressures = [pressure for sweep in file.sweeps for pressure in sweep.pressures_pa]
    return Template(
        name,
        length,
        float(np.sqrt(area / np.pi)),
        float(part.volume.sum() * part.material.density_kg_per_m3),
        area,
        second_moment,
        specimen.chambers,
        (min(0.0, *pressures), max(0.0, *pressures)),
        file.viscosity_pa_s,
        file.gravity,
        file.base_quaternion,
    )


def parameters(known: Template, start: Direct) -> list[Parameter]:
    """Return the unknowns of a link with the bounds of a joint fit.

    k(s) = level + (level - rest) (tanh^2(rate s) - 1), so that `rest` is the stiffness at rest, which a known
    force gives, and `level` that of large strains.
    """

    def near(name: str, value: float, share: float) -> Parameter:
        return Parameter(name, value, (1.0 - share) * value, (1.0 + share) * value)

    k_e, k_b = start.k_e_n_per_m, start.k_b_nm
    slope = Parameter("area_slope", float(np.clip(start.area_slope, -SLOPE, SLOPE)), -SLOPE, SLOPE, 1.0)
    if known.chambers == 1:
        return [near("k_b_rest", k_b, ARM), near("offset_m", start.offset_m, ARM), slope]
    return [
        near("k_e_rest", k_e, FORCES),
        Parameter("k_e_level", 0.8 * k_e, k_e / LEVEL, LEVEL * k_e),
        Parameter("k_e_rate", 50.0, 1.0, 1000.0),
        near("k_b_rest", k_b, FORCES),
        Parameter("k_b_level", 0.8 * k_b, k_b / LEVEL, LEVEL * k_b),
        Parameter("k_b_rate", 2.0, 0.1, 20.0),
        near("area_m2", start.area_m2, AREA),
        near("offset_m", start.offset_m, ARM),
        slope,
    ]


def completed(known: Template, start: Direct, values: Mapping[str, float]) -> dict[str, float]:
    """Return the numbers of a link with those that a fit of a single chamber does not find.

    Its link keeps its length, its pressure acts by area times offset alone, and what bends it less and less
    is the chamber (`area_slope`): its stiffness is one number.
    """
    if known.chambers > 1:
        return dict(values)
    k_e = start.k_e_n_per_m
    fixed = {"k_e_rest": k_e, "k_e_level": k_e, "k_e_rate": 50.0, "k_b_rate": 2.0, "area_m2": start.area_m2}
    return {**fixed, "k_b_level": values["k_b_rest"], **values}


def at_bound(known: Template, start: Direct, values: Mapping[str, float]) -> list[str]:
    """Return the numbers that a fit would move farther than it may."""
    return [
        p.name
        for p in parameters(known, start)
        if min(values[p.name] - p.lower, p.upper - values[p.name]) < 1e-3 * (p.upper - p.lower)
    ]


def robot_of(known: Template, values: Mapping[str, float], strains: Mapping[str, Any] | None = None) -> Robot:
    """Return the robot of one link with these numbers.

    Parameters
    ----------
    known : Template
    values : mapping
    strains : mapping, optional
        As in `robot_keys`.
    """
    return robot_from_dict(robot_keys(known, values, strains))


def robot_keys(
    known: Template, values: Mapping[str, float], strains: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """Return the keys of the robot file of one link with these numbers.

    Parameters
    ----------
    known : Template
        What does not change.
    values : mapping
        Of `parameters`.
    strains : mapping, optional
        Shape functions of the strains, as in a robot file; by default constant.
    """
    laws = {}
    for name in ("k_e", "k_b"):
        level, rest, rate = (values[f"{name}_{what}"] for what in ("level", "rest", "rate"))
        laws[name] = [level, level - rest, rate]
    chambers = [
        {
            "angle_rad": 2.0 * np.pi * c / known.chambers,
            "area_m2": values["area_m2"],
            "offset_m": values["offset_m"],
            "area_slope": values["area_slope"],
        }
        for c in range(known.chambers)
    ]
    damping = known.damping
    if strains is not None:
        strains = {name: strains[name] for name in known.strains}
    elif len(known.strains) < 3:  # a file without the key has all three
        strains = {name: {"basis": "constant"} for name in known.strains}
    if strains is not None:
        each = [field.get("modes", 1) for field in strains.values()]
        damping = tuple(np.repeat(damping, each).tolist())
    link = {
        "length": known.length_m,
        "radius": known.radius_m,
        "mass": known.mass_kg,
        **laws,
        "damping": list(damping),
        "chambers": chambers,
    }
    if strains is not None:
        link["strains"] = dict(strains)
    return {
        "name": known.name,
        "gravity": list(known.gravity),
        "base_quaternion": list(known.base_quaternion),
        # The angle of bending of a rod of solid rubber is kappa L, whatever its elongation.
        "bend_angle": "geometric",
        "pressure_range_pa": list(known.pressure_range_pa),
        "links": [link],
    }

"""Values with units, ``40kPa`` or ``10 g``, of files, of ``--set`` and of the options of commands.

A key states its unit by its suffix, ``mean_pressure_pa``; a number alone is in that unit.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from soro_core.errors import ConfigError

_DEG = math.pi / 180.0
# What a unit measures, and the other units of the same with their factors; a number alone is in the first.
_KINDS: dict[str, tuple[str, dict[str, float]]] = {
    "Pa": ("pressure", {"kPa": 1e3, "MPa": 1e6, "bar": 1e5, "mbar": 1e2, "psi": 6894.757}),
    "kg": ("mass", {"g": 1e-3, "mg": 1e-6}),
    "m": ("length", {"cm": 1e-2, "mm": 1e-3, "um": 1e-6}),
    "mm": ("length", {"m": 1e3, "cm": 10.0, "um": 1e-3}),
    "s": ("time", {"ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0}),
    "us": ("time", {"ms": 1e3, "s": 1e6}),
    "Hz": ("frequency", {"kHz": 1e3}),
    "rad": ("angle", {"deg": _DEG}),
    "deg": ("angle", {"rad": 1.0 / _DEG}),
    "N": ("force", {"mN": 1e-3, "kN": 1e3}),
    "V": ("voltage", {"mV": 1e-3}),
    "m2": ("area", {"cm2": 1e-4, "mm2": 1e-6}),
    "m3": ("volume", {"l": 1e-3, "ml": 1e-6, "cm3": 1e-6, "mm3": 1e-9}),
    "m4": ("fourth power of a length", {"cm4": 1e-8, "mm4": 1e-12}),
    "m/s": ("speed", {"cm/s": 1e-2, "mm/s": 1e-3}),
    "m/s2": ("acceleration", {"cm/s2": 1e-2, "mm/s2": 1e-3}),
    "rad/s": ("angular velocity", {"deg/s": _DEG}),
    "Pa/s": ("rate of pressure", {"kPa/s": 1e3, "bar/s": 1e5}),
    "1/m": ("curvature", {"1/cm": 1e2, "1/mm": 1e3, "rad/m": 1.0, "deg/m": _DEG}),
    "1/s": ("rate", {"1/ms": 1e3, "rad/s": 1.0}),
    "1/(ms)": ("rate of curvature", {}),
    "1/Pa": ("part per pressure", {"1/kPa": 1e-3, "1/bar": 1e-5}),
    "Pas": ("viscosity", {"kPas": 1e3}),
    "kg/m": ("mass per length", {"g/m": 1e-3, "g/cm": 0.1, "g/mm": 1.0}),
    "kg/m3": ("density", {"g/cm3": 1e3}),
    "N/m": ("stiffness", {"N/mm": 1e3}),
    "Nm": ("torque", {"Nmm": 1e-3, "mNm": 1e-3}),
    "Nm/rad": ("stiffness", {"Nmm/rad": 1e-3}),
    "Nms/rad": ("damping", {"Nmms/rad": 1e-3}),
    "kgm2": ("moment of inertia", {"gcm2": 1e-7}),
    "Ns/m": ("damping", {"Ns/mm": 1e3}),
    "s/m": ("time per length", {"s/mm": 1e3, "ms/mm": 1.0}),
    "m3/(sPa)": ("conductance", {"l/(sbar)": 1e-8}),
    "Pa/V": ("pressure per voltage", {"kPa/V": 1e3, "bar/V": 1e5}),
    "": ("number", {}),
}
# Units of keys by the end of their names.
_SUFFIXES = {
    **{
        unit.lower(): unit
        for unit in ("Pa", "kg", "m", "mm", "s", "us", "Hz", "rad", "deg", "N", "Nm", "V", "m2", "m3")
    },
    "m_s": "m/s",
    "m_s2": "m/s2",
    "rad_s": "rad/s",
    "pa_s": "Pa/s",
    "pa_v": "Pa/V",
    "n_m": "N/m",
    "n_m_rad": "Nm/rad",
    "kg_per_m3": "kg/m3",
    "m3_s_pa": "m3/(sPa)",
    "per_m": "1/m",
    "per_s": "1/s",
    "per_m_s": "1/(ms)",
    "per_pa": "1/Pa",
}
# Units of keys whose names do not tell, or whose ends tell another one; "" for one that none of these has.
_NAMES = {
    **dict.fromkeys(
        ("length", "radius", "base_position", "tracker_position", "wrench_places", "centre"), "m"
    ),
    **dict.fromkeys(("mass", "tip_mass"), "kg"),
    **dict.fromkeys(("youngs_modulus", "shear_modulus"), "Pa"),
    "gravity": "m/s2",
    "viscosity": "Pas",
    "viscosity_pa_s": "Pas",
    "tau": "s",
    "slip_velocity": "m/s",
    "mass_per_m": "kg/m",
    "curvature_offset": "1/m",
    "alpha_eps": "m3",
    "alpha_kappa": "m4",
    # Accelerations of curvatures, 1/(m s^2), and their spectral densities.
    **dict.fromkeys(
        (
            "curvature_acceleration_per_m",
            "curvature_disturbance_per_m",
            "curvature_disturbance_std_per_m",
        ),
        "",
    ),
    "Link.density": "kg/m3",
    "pa_per_n": "Pa/N",
    "Injection.at": "s",
    **dict.fromkeys(("PointMass.place", "LinkSection.place", "Attachment.place", "TipConstraint.point"), "m"),
    **dict.fromkeys(("Plane.point", "Wall.point", "BoxShape.size", "RigidBody.position"), "m"),
    **dict.fromkeys(("HingeAxis.point", "Hinge.point", "MeshShape.corners"), "m"),
    "RigidBody.velocity": "m/s",
    "RigidBody.angular_velocity": "rad/s",
    "RigidBody.inertia": "kgm2",
    "Hinge.stiffness": "Nm/rad",
    "Hinge.damping": "Nms/rad",
    "HingeDrive.stiffness": "Nm/rad",
    "HingeDrive.damping": "Nms/rad",
    "CounterbalanceSettings.stiffness": "Nm/rad",
    "CounterbalanceSettings.damping": "Nms/rad",
    **dict.fromkeys(
        (f"{one}.stiffness" for one in ("Surface", "Plane", "Sphere", "Wall", "TipConstraint")), "N/m"
    ),
    **dict.fromkeys((f"{one}.damping" for one in ("Surface", "Plane", "Sphere", "Wall")), "s/m"),
    "TipConstraint.damping": "Ns/m",
}
_NUMBER = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\D.*|)")


def unit_of(key: str, section: str = "") -> str:
    """Return the unit of a key in the section that a class checks, "" where its name states none."""
    named = _NAMES.get(f"{section}.{key}", _NAMES.get(key))
    if named is not None:
        return named
    words = key.split("_")
    return next(filter(None, (_SUFFIXES.get("_".join(words[k:])) for k in range(1, len(words)))), "")


def as_number(value: Any, unit: str) -> Any:
    """Return a value of a file with each text like ``40kPa`` in it as a number in a unit.

    Parameters
    ----------
    value : object
        Of the file: a number or a text, or lists or mappings of them. Texts that do not begin with a number
        are returned as they are.
    unit : str
        Unit that numbers alone are in.

    Raises
    ------
    ValueError
        With the units that are allowed, for any other one.
    """
    if isinstance(value, str):
        match = _NUMBER.fullmatch(value.strip())
        return value if match is None or not match[2] else _converted(float(match[1]), match[2], unit)
    if isinstance(value, list | tuple):
        has_text = any(isinstance(item, str | list | tuple) for item in value)
        return [as_number(item, unit) for item in value] if has_text else value
    if isinstance(value, Mapping):
        return {key: as_number(item, unit) for key, item in value.items()}
    return value


def _converted(number: float, own: str, unit: str) -> float:
    plain = own.replace(" ", "").replace("^", "").replace("µ", "u")
    factor = 1.0 if plain == unit else _KINDS[unit][1].get(plain)
    if factor is None:
        raise ValueError(f"{_kind(unit)} {_units(unit, unit)}")
    # Round-off of the factor away: 80 mm are 0.08 m.
    return float(f"{number * factor:.15g}")


def _kind(unit: str) -> str:
    kind = _KINDS[unit][0]
    return f"an {kind}" if kind[0] in "aeiou" else f"a {kind}"


def _units(unit: str, alone: str) -> str:
    """Say which units are allowed, and the one of a number alone."""
    return (
        f"in {', '.join((unit, *_KINDS[unit][1]))}; a number alone is in {alone}"
        if unit
        else "without a unit"
    )


@dataclass(frozen=True)
class Quantity:
    """Numbers with a unit on a command line.

    Attributes
    ----------
    unit : str
        What a number alone is in.
    lowest, highest : float
        Bounds in this unit.
    example : str
        How it is written.
    alone : str
        Another unit for numbers alone; "" for `unit`.
    """

    unit: str
    lowest: float
    highest: float
    example: str
    alone: str = ""

    def read(self, text: str, where: str, key: str = "") -> tuple[float, ...]:
        """Return the numbers of a text, separated by commas, in the unit of the quantity.

        A number without a unit has that of the last number of the text.

        Raises
        ------
        ConfigError
            With the option, the text and what is allowed.
        """
        found = [_NUMBER.fullmatch(part.strip()) for part in text.split(",")]
        pairs = [(float(match[1]), match[2].strip()) for match in found if match is not None]
        try:
            if len(pairs) < len(found):
                raise ValueError(text)
            last = pairs[-1][1] or self.alone or self.unit
            numbers = tuple(_converted(number, own or last, self.unit) for number, own in pairs)
            if not all(math.isfinite(x) and self.lowest <= x <= self.highest for x in numbers):
                raise ValueError(text)
        except ValueError:
            alone = self.alone or self.unit
            allowed = f"{_kind(self.unit)}{self._bounds}{self._like}, {_units(self.unit, alone)}"
            raise ConfigError(where, key, text, allowed) from None
        return numbers

    def number(self, text: str, where: str, key: str = "") -> float:
        """Return the one number of a text; errors as of `read`."""
        numbers = self.read(text, where, key)
        if len(numbers) > 1:
            raise ConfigError(where, key, text, f"one number{self._like}")
        return numbers[0]

    @property
    def _like(self) -> str:
        return f", like {self.example}" if self.example else ""

    @property
    def _bounds(self) -> str:
        low, high = (f"{x:g} {self.unit}".strip() for x in (self.lowest, self.highest))
        if self.highest == math.inf:
            return "" if self.lowest == -math.inf else f" from {low} on"
        return f" from {low} to {high}"


def unit_option(
    flag: str, unit: str, lowest: float = -math.inf, highest: float = math.inf, example: str = "", **rest: Any
) -> Any:
    """Return an option of a command for one number with a unit.

    Parameters
    ----------
    flag : str
        ``--pressure``.
    unit : str
        What a number alone is in, and the command gets.
    lowest, highest : float
        Bounds in this unit.
    example : str
        How it is written; the default value, if the option has one.
    **rest
        As of `typer.Option`.
    """
    import typer

    quantity = Quantity(unit, lowest, highest, example)

    def read(text: str | float) -> float:
        # a number: the default
        return quantity.number(text, "command line", flag) if isinstance(text, str) else text

    shown = {"metavar": _KINDS[unit][0], "show_default": example or False}
    return typer.Option(flag, parser=read, **{**shown, **rest})

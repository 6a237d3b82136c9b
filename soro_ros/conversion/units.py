"""Units in the names of columns: those of soro's topics, and of ROS types that have the same everywhere."""

from __future__ import annotations

import re

# End of the topic, path in the message, unit. The first that fits counts.
_CHAMBERS = r"/(chambers/(command|state)|truth/chambers)"
_STATES, _JOINT = r"/(arm|truth)/state", r"/bodies/[^/]+/joint"
_CURVED, _PLAIN = r"\.[^.]*(bending|torsion)[^.]*", r"\.[^.]*(elongation|shear)[^.]*"
_RULES = (
    (_CHAMBERS, r"effort\..+", "pa"),
    (r"/chambers/commands", r"data\..+", "pa"),
    (_STATES, "position" + _CURVED, "per_m"),
    (_STATES, "velocity" + _CURVED, "per_m_s"),
    (_STATES, "velocity" + _PLAIN, "per_s"),
    (_STATES, "effort" + _CURVED, "j_m"),
    (_STATES, "effort" + _PLAIN, "j"),
    (_JOINT, r"position\..+", "rad"),
    (_JOINT, r"velocity\..+", "rad_s"),
    (_JOINT, r"effort\..+", "n_m"),
    (r"/sensors/length", r"position\..+", "m"),
    ("", r"(.+\.)?(position|translation)\.[xyz]", "m"),
    ("", r"(.+\.)?angular_velocity\.[xyz]", "rad_s"),
    ("", r"(.+\.)?linear_acceleration\.[xyz]", "m_s2"),
    ("", r"(.+\.)?linear\.[xyz]", "m_s"),
    ("", r"(.+\.)?angular\.[xyz]", "rad_s"),
    ("", r"(.+\.)?force\.[xyz]", "n"),
    ("", r"(.+\.)?torque\.[xyz]", "n_m"),
    (r"/arm/wrench/covariance", r"position\.[xyz]{2}", "n2"),
)
_SHOWN = {
    "pa": "kPa",
    "per_m": "1/m",
    "per_m_s": "1/(m s)",
    "per_s": "1/s",
    "j_m": "J m",
    "j": "J",
    "m": "m",
    "rad": "rad",
    "rad_s": "rad/s",
    "m_s2": "m/s²",
    "m_s": "m/s",
    "n": "N",
    "n_m": "N m",
    "n2": "N²",
}
_UNITS = sorted({unit for _, _, unit in _RULES}, key=len, reverse=True)


def unit_of(topic: str, path: str) -> str:
    """Return the unit of a value; empty where it has none, or none that is known."""
    for end, pattern, unit in _RULES:
        if re.search(f"{end}$", topic) and re.fullmatch(pattern, path):
            return unit
    return ""


def shown_in(unit: str) -> tuple[str, float]:
    """Return how a picture shows a unit of `unit_of`, and its factor: ``kPa`` and 1e-3 for ``pa``."""
    return _SHOWN[unit], 1e-3 if unit == "pa" else 1.0


def column_of(topic: str, path: str) -> str:
    """Return the name of a column: the path with its unit."""
    unit = unit_of(topic, path)
    return f"{path}_{unit}" if unit else path


def path_of(topic: str, column: str) -> str:
    """Return the path of a column; one whose unit is missing or another one is no path, and so ''."""
    for unit in _UNITS:
        if column.endswith(f"_{unit}") and unit_of(topic, path := column.removesuffix(f"_{unit}")) == unit:
            return path
    return "" if unit_of(topic, column) else column

"""The arm of the tests of control, near the three-bellow one, and bounds of all that can be adapted."""

import numpy as np

from soro_core.config import parse
from soro_core.control.passivity.adaptation_config import Adaptation

CHAMBERS = [{"angle_rad": k * 2 * np.pi / 3, "alpha_eps": 1.25e-6, "alpha_kappa": 1.0e-8} for k in range(3)]
LAW = {
    "length": 0.064,
    "radius": 0.013,
    "mass": 0.017,
    "k_e": [1210.0, 942.0, 45.55],
    "k_b": [0.0085, 0.0025, 3.0],
    "chambers": CHAMBERS,
}
LINK = {**LAW, "damping": [0.01, 2e-7, 2e-7]}
ROBOT = {"name": "test arm", "base_quaternion": [1.0, 0.0, 0.0, 0.0]}
BOUNDS = {
    "a1": (1e5, 100.0, 2e4),
    "a2": (1e5, 0.0, 2e4),
    "a4": (4e-3, 1e-3, 0.1),
    "a5": (4e-3, 0.0, 0.1),
    "damping_stretch": (1e-2, 0.0, 1.0),
    "damping_curvature": (1e-9, 0.0, 1e-4),
    "tip_mass": (0.1, 0.0, 0.2),
    "link_mass": (0.1, 0.001, 0.2),
    "chamber_gain": (1.0, 0.5, 2.0),
}


def adaptation(*names, **changes):
    """Adaptation of these parameters within `BOUNDS`."""
    rows = [BOUNDS[name] for name in names]
    values = {key: [row[i] for row in rows] for i, key in enumerate(("gain", "lower", "upper"))}
    return parse({"parameters": list(names), **values, **changes}, Adaptation, "test")

"""A robot and a grid that are quick to study."""

from soro_core import robot_from_dict
from soro_core.jobs import Here
from soro_lab.trade.grid import CandidateGrid

ROBOT = {
    "name": "small",
    "base_quaternion": [1.0, 0.0, 0.0, 0.0],  # hanging
    "links": [
        {
            "length": 0.2,
            "radius": 0.01,
            "density": 1100.0,
            "strains": {"bending_x": {"basis": "constant"}},
            "material": {
                "youngs_modulus": 3e5,
                "shear_modulus": 1e5,
                "viscosity": 200.0,
                "shear_correction": False,  # takes most of the time of making an arm
            },
            "chambers": [{"angle_rad": 0.0, "area_m2": 2e-5, "offset_m": 0.006}],
        }
    ],
}
GRID = CandidateGrid((1, 2), (("legendre", 1, 1),), (0, 3), (8,), (0.02, 0.01, 0.005), (0.02, 0.005), 4, 1)


def robot():
    return robot_from_dict(ROBOT)


class Counting(Here):
    """Counts what is computed."""

    def __init__(self):
        self.done = []

    def submit(self, function, item):
        self.done.append(item)
        return super().submit(function, item)

"""Small tasks for tests: a bellow of 24 x 12 elements, and the eighth of a box that air is to lengthen."""

from pathlib import Path

from soro_core.config import config_folder, read_yaml
from soro_design.topology import task_from_dict


def bellow(**changes):
    """Return the shipped bellow on a coarse grid, no lids; a mapping without a kind replaces some keys."""
    data = read_yaml(config_folder() / "design" / "bellow.yaml")
    del data["lid_mm"], data["height_mm"]
    data |= {"cells": [24, 12], "filter_radius_m": 0.0018}
    data["schedule"] |= {"iterations": 14, "ramp": 8, "pressure_pa": [5e2, 1e3]}
    data["goal"]["energy_exponent"] = 0.7
    for key, value in changes.items():
        is_part = isinstance(value, dict) and "kind" not in value
        data[key] = {**data.get(key, {}), **value} if is_part else value
    return task_from_dict(data)


def box(**changes):
    """Return the task of box.yaml on a coarse grid, from grey everywhere; other keys replace some of it."""
    data = read_yaml(Path(__file__).with_name("box.yaml"))
    data |= {"cells": [6, 5, 6], "filter_radius_m": 0.003, "start": []}
    data["schedule"] |= {"iterations": 3, "ramp": 2, "pressure_pa": [5e2, 1e3], "sharpness": [2.0]}
    return task_from_dict(data | changes)


def ball():
    """The eighth of a box with its output in the plane y = 0."""
    goal = {"kind": "farthest", "material": "dragonskin_10", "poisson_ratio": 0.45, "spring_pa": 0.0}
    face = {"kind": "box", "y_m": [0.0, 0.0]}
    return box(cells=[12, 12, 9], goal=goal | {"output": face, "direction": [1.0, 0.0, 0.0]})

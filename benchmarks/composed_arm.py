"""The arm of the measurements: two links, the law `composite`, a twin in the place of valves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from soro_core.config import find_config, read_yaml

# Hangs with its weight in stretch; standing, two such links fall over.
_HANGING = [1.0, 0.0, 0.0, 0.0]


def parameter_file(folder: Path, rate_hz: float, **changes: Any) -> Path:
    """Write robot and parameters of estimator, controller and twin into a folder.

    Parameters
    ----------
    folder : Path
    rate_hz : float
        Rate of the loop.
    **changes : object
        Other parameters of every node.

    Returns
    -------
    Path
        Parameter file of `soro_arm`.
    """
    robot = read_yaml(find_config("tue_three_bellow", "robots"))
    robot |= {"links": [robot["links"][0]] * 2, "base_quaternion": _HANGING}
    robot.pop("calibration")  # of the bodies on the single link
    file = folder / "two_links.yaml"
    file.write_text(yaml.safe_dump(robot))
    # The pressures stay within their range, 12 to 77 kPa.
    reference, regulators = {"kind": "circle", "curvature_per_m": 2.0}, {"maximum_pa": 90e3}
    pose = {"rate_hz": 100.0, "delay_s": 0.006}
    nodes = {
        "/**": {"robot": str(file), "rate_hz": rate_hz, **changes},
        # The plant has two links where the model has one.
        "/**/twin": {"refine": 2, "payload_kg": 0.01, "pose": pose, "regulator": regulators},
        "/**/controller": {
            "platform": "",
            "regulator": dict(regulators),  # the parser of ROS takes no alias
            "enabled": True,
            "control": {"law": "composite", "reference": reference},
        },
    }
    path = folder / "parameters.yaml"
    path.write_text(yaml.safe_dump({name: {"ros__parameters": keys} for name, keys in nodes.items()}))
    return path

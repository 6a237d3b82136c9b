"""States of a rod as a link of known numbers moves it, in the place of finite elements."""

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

from soro_core.model import SoftArm
from soro_core.model.equilibrium.statics import equilibrium
from soro_core.rotation import skew
from soro_design.parts.sweeps import Backbone
from soro_design.robot_of_part.joint import weightless
from soro_design.robot_of_part.link import Template, robot_of
from soro_design.robot_of_part.snapshots import snapshots

LENGTH = 0.08
Z = np.linspace(0.0, LENGTH, 17)
KNOWN = Template(
    "made", LENGTH, 0.01, 0.03, 3e-4, 1.2e-8, 3, (0.0, 40e3), 100.0, (0.0, 0.0, -9.81), (0.0, 0.0, 0.0, 1.0)
)
VALUES = {
    "k_e_rest": 900.0,
    "k_e_level": 700.0,
    "k_e_rate": 150.0,
    "k_b_rest": 0.05,
    "k_b_level": 0.04,
    "k_b_rate": 2.5,
    "area_m2": 4.5e-5,
    "offset_m": 6.5e-3,
    "area_slope": 1.2,
}
PRESSED = {
    "all": (40e3, 40e3, 40e3),
    "one": (40e3, 0.0, 0.0),
    "two": (40e3, 30e3, 0.0),
    "mixed": (10e3, 20e3, 40e3),
}
NOTHING = (0.0, 0.0, 0.0)


def poses_of(strains):
    """Poses (17, 4, 4) of constant strains (16, 6) between the sections."""
    poses = [np.eye(4)]
    for twist, length in zip(strains, np.diff(Z), strict=True):
        hat = np.zeros((4, 4))
        hat[:3, :3], hat[:3, 3] = skew(twist[:3]), twist[3:]
        poses.append(poses[-1] @ expm(length * hat))
    return np.array(poses)


def uniform(elongation, bending_x=0.0, bending_y=0.0):
    return poses_of(np.tile([-bending_y, bending_x, 0.0, 0.0, 0.0, 1.0 + elongation], (16, 1)))


def made_states(values=VALUES, n=4, shear=0.0):
    """Backbones of every kind of sweep; `shear` (shear_x per force across, 1/N) adds to the deflection."""
    states = []
    for pull in (7.0, -2.0):
        for load in np.arange(1, n + 1) / n:
            k = {what: values[f"k_e_{what}"] for what in ("level", "rest", "rate")}
            x = brentq(
                lambda x, k=k, f=load * pull: (
                    (k["level"] + (k["level"] - k["rest"]) * (np.tanh(k["rate"] * x) ** 2 - 1.0)) * x - f
                ),
                -0.05,
                0.05,
            )
            states.append(
                Backbone("pull", load, np.zeros(3), np.array([0, 0, load * pull]), False, uniform(x / LENGTH))
            )
    force = 1e-3
    middle = 0.5 * (Z[1:] + Z[:-1])
    strains = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (16, 1))
    strains[:, 1] = force * (LENGTH - middle) / (values["k_b_rest"] * LENGTH)
    strains[:, 3] = shear * force
    states.append(Backbone("side", 1.0, np.zeros(3), np.array([force, 0, 0]), False, poses_of(strains)))
    arm = SoftArm(robot_of(weightless(KNOWN), values))
    for name, pressures in PRESSED.items():
        for load in np.arange(1, n + 1) / n:
            q = equilibrium(arm, load * np.array(pressures))
            held_out = name == "mixed"
            states.append(
                Backbone(name, load, load * np.array(pressures), np.zeros(3), held_out, uniform(*q))
            )
    return states


def made_data(**options):
    return snapshots(Z, made_states(**options), "made")

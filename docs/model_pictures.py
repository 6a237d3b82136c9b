"""Draw the pictures of docs/model.md: backbone and frames, strains and their shape functions, convergence.

python docs/model_pictures.py [--folder docs/images]
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from soro_core import SoftArm, robot_from_dict
from soro_core.model.equilibrium.statics import equilibrium
from soro_core.robot import Robot, shape_values

LENGTH, RADIUS = 0.2, 0.015
# Amounts that show well, for each strain alone.
SHOWN = {
    "bending_x": 6.0,
    "bending_y": 6.0,
    "torsion": 8.0,
    "elongation": 0.35,
    "shear_x": 0.35,
    "shear_y": 0.35,
}
AXES = (("x", "tab:red"), ("y", "tab:green"), ("z", "tab:blue"))
ELEVATION, AZIMUTH = 18.0, -55.0
BAR = 0.05


def rod(fields: dict[str, Any], n_links: int = 1, youngs_modulus: float = 1e5) -> Robot:
    """Rod of silicone, clamped level, cut into links."""
    root = float(np.sqrt(0.5))
    link = {
        "length": LENGTH / n_links,
        "radius": RADIUS,
        "density": 1100.0,
        "material": {"youngs_modulus": youngs_modulus, "shear_modulus": youngs_modulus / 3},
        "strains": fields,
    }
    return robot_from_dict({"links": [link] * n_links, "base_quaternion": [0.0, root, 0.0, root]})


def legendre(**degrees: int) -> dict[str, Any]:
    """Fields of Legendre polynomials."""
    return {name: {"basis": "legendre", "order": degree} for name, degree in degrees.items()}


def draw_arm(axes: Any, arm: SoftArm, q: Any, frames: int, size: float) -> None:
    """Backbone, outline of some sections, and the frames (Phi, p) along it."""
    poses = [arm.pose(q, s) for s in np.linspace(0.0, arm.length, 61)]
    p = np.array([pose[:3, 3] for pose in poses])
    axes.plot(*p.T, color="black", linewidth=1.5)
    around = np.linspace(0.0, 2 * np.pi, 40)
    ring = RADIUS * np.array([np.cos(around), np.sin(around), np.zeros_like(around)])
    for pose in poses[:: 60 // frames]:
        axes.plot(*(pose[:3, :3] @ ring + pose[:3, 3:]), color="0.7", linewidth=0.8)
        for k, (_, colour) in enumerate(AXES):
            tip = pose[:3, 3] + size * pose[:3, k]
            axes.plot(*np.stack([pose[:3, 3], tip]).T, color=colour, linewidth=1.5)
    low, high = p.min(axis=0) - 1.2 * RADIUS, p.max(axis=0) + 1.2 * RADIUS
    half = (high - low).max() / 2
    middle = (high + low) / 2
    for limits, at in zip((axes.set_xlim, axes.set_ylim, axes.set_zlim), middle, strict=True):
        limits(at - half, at + half)
    axes.set_box_aspect((1, 1, 1), zoom=1.5)
    axes.set_axis_off()
    # Lengths can be compared: no perspective, and a bar beside the base.
    axes.set_proj_type("ortho")
    axes.view_init(ELEVATION, AZIMUTH)
    turn = np.radians(AZIMUTH)
    beside = -3.2 * RADIUS * np.array([-np.sin(turn), np.cos(turn), 0.0])
    bar = beside + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, BAR]])
    axes.plot(*bar.T, color="black", linewidth=3, solid_capstyle="butt")
    axes.text(*(bar[0] - [0.0, 0.0, 0.005]), f"{1e3 * BAR:g} mm", fontsize=8, ha="center", va="top")


def picture_of_frames(path: Path) -> None:
    """A bent arm with its frames, and what each strain does to a straight link."""
    figure = Figure(figsize=(12, 5), layout="constrained")
    left, right = figure.subfigures(1, 2, width_ratios=(1, 1.6))
    axes = left.add_subplot(projection="3d")
    arm = SoftArm(robot_from_dict({"links": [_upright(legendre(bending_x=1, bending_y=2, torsion=0))]}))
    draw_arm(axes, arm, np.array([8.0, 6.0, 4.0, 5.0, -3.0, 6.0]), 10, 0.022)
    for name, colour in AXES:
        axes.plot([], [], [], color=colour, label=f"{name} of the frame Phi(sigma)")
    axes.plot([], [], [], color="black", label="backbone p(sigma)")
    axes.legend(loc="upper left", fontsize=8)
    left.suptitle(f"pose along an arm of {1e3 * LENGTH:g} mm, base at the bottom")
    right.suptitle("each strain alone, uniform (bending_x turns about y, bending_y about minus x)")
    for k, (name, amount) in enumerate(SHOWN.items()):
        axes = right.add_subplot(2, 3, k + 1, projection="3d")
        arm = SoftArm(robot_from_dict({"links": [_upright({name: {}})]}))
        axes.plot([0, 0], [0, 0], [0, LENGTH], color="0.6", linestyle=":")
        draw_arm(axes, arm, np.array([amount]), 6, 0.03)
        unit = "1/m" if name in ("bending_x", "bending_y", "torsion") else ""
        axes.set_title(f"{name} {amount:g} {unit}", fontsize=9)
    figure.savefig(path, dpi=110)


def _upright(fields: dict[str, Any]) -> dict[str, Any]:
    material = {"youngs_modulus": 1e6, "shear_modulus": 4e5}
    return {"length": LENGTH, "radius": RADIUS, "mass": 0.1, "material": material, "strains": fields}


def picture_of_bases(path: Path) -> None:
    """Shape functions of each kind."""
    at = np.linspace(0.0, 1.0, 201)
    coarse = np.linspace(0.0, 1.0, 9)
    modes = np.stack([1.0 - coarse, np.sin(2.5 * coarse), (1 - coarse) ** 2 * coarse * 5], axis=1)
    kinds = {
        "constant": {"basis": "constant"},
        "legendre, order 4": {"basis": "legendre", "order": 4},
        "chebyshev, order 4": {"basis": "chebyshev", "order": 4},
        "pod: modes from samples": {"basis": "pod", "samples": modes.tolist()},
    }
    figure = Figure(figsize=(12, 2.9), layout="constrained")
    for axes, (name, field) in zip(figure.subplots(1, 4, sharey=True), kinds.items(), strict=True):
        link = robot_from_dict({"links": [_upright({"bending_x": field})]}).links[0]
        for values in shape_values(link, at * LENGTH):
            axes.plot(at, values)
        if "pod" in name:
            axes.plot(coarse, modes, "k.", markersize=4)
        axes.set_title(name, fontsize=10)
        axes.set_xlabel("sigma / L")
        axes.grid(True, alpha=0.3)
        if name == "constant":
            axes.set_ylabel("shape function phi (no unit)")
            for k in range(1, 5):
                axes.plot([], [], color=f"C{k}")
            axes.legend([f"coordinate {k}" for k in range(5)], fontsize=8, loc="lower left")
    figure.savefig(path, dpi=110)


def backbone(arm: SoftArm) -> Any:
    """Points of the sagging arm at rest."""
    q = equilibrium(arm, [])
    return np.array([arm.pose(q, s)[:3, 3] for s in np.linspace(0.0, LENGTH, 21)])


def shape_error(arm: SoftArm, right: Any) -> float:
    """Root mean square distance of the backbone at rest, over the length."""
    return float(np.sqrt(((backbone(arm) - right) ** 2).sum(axis=1).mean())) / LENGTH


def picture_of_convergence(path: Path) -> None:
    """Error against coordinates, and against steps along the backbone."""
    figure = Figure(figsize=(12, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    for modulus, colour in ((1e5, "tab:blue"), (5e5, "tab:orange")):
        exact = backbone(SoftArm(rod(legendre(bending_x=12, elongation=12), 1, modulus), nodes=80))
        curves = {}
        for degree in range(9):
            arm = SoftArm(rod(legendre(bending_x=degree, elongation=degree), 1, modulus), nodes=80)
            curves[arm.n_q] = shape_error(arm, exact)
        left.semilogy(
            *zip(*curves.items(), strict=True),
            "o-",
            color=colour,
            label=f"polynomials, E = {1e-3 * modulus:g} kPa",
        )
        curves = {}
        for n in (1, 2, 3, 4, 6, 8):
            arm = SoftArm(rod({"bending_x": {}, "elongation": {}}, n, modulus))
            curves[arm.n_q] = shape_error(arm, exact)
        left.semilogy(
            *zip(*curves.items(), strict=True), "s--", color=colour, label="links of constant strain"
        )
    left.set_xlabel("coordinates")
    left.set_ylabel("error of the backbone, of the length")
    left.set_title("level rod, 200 mm, sagging under its weight", fontsize=10)
    robot = rod(legendre(bending_x=3, bending_y=2, elongation=1))
    q = np.array([6.0, -5.0, 4.0, 3.0, -6.0, 5.0, 3.0, 0.05, -0.05])
    exact_pose = SoftArm(robot, nodes=500).pose(q, LENGTH)
    exact_inertia = SoftArm(robot, nodes=500).inertia_matrix(q)
    counts = [8, 12, 16, 24, 32, 48, 64, 96]
    for method, key, colour in (("mde", "steps", "tab:red"), ("exact", "nodes", "tab:blue")):
        arms = [SoftArm(robot, method=method, **{key: n}) for n in counts]  # type: ignore[arg-type]
        pose = [np.abs(arm.pose(q, LENGTH) - exact_pose)[:3, 3].max() / LENGTH for arm in arms]
        mass = [np.abs(arm.inertia_matrix(q) - exact_inertia).max() / exact_inertia.max() for arm in arms]
        right.loglog(counts, pose, "o-", color=colour, label=f"{method}: tip position, of the length")
        right.loglog(
            counts, mass, "s--", color=colour, label=f"{method}: inertia matrix, of its largest entry"
        )
    n = np.array([12.0, 96.0])
    right.loglog(n, 3.0 * n**-2, "k:", linewidth=1)
    right.loglog(n, 3.0 * n**-4, "k:", linewidth=1)
    right.text(60, 1.6e-3, "order 2", fontsize=8)
    right.text(60, 4e-7, "order 4", fontsize=8)
    right.set_xlabel("steps (mde) or nodes (exact) a link")
    right.set_ylabel("relative error")
    right.set_title("one strongly bent link of cubic strain", fontsize=10)
    for axes in (left, right):
        axes.grid(True, which="major", alpha=0.3)
        axes.legend(fontsize=8)
    figure.savefig(path, dpi=110)


def main() -> None:
    """Draw all of them."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--folder", type=Path, default=Path("docs/images"))
    folder = parser.parse_args().folder
    picture_of_frames(folder / "model_frames.png")
    picture_of_bases(folder / "model_bases.png")
    picture_of_convergence(folder / "model_convergence.png")


if __name__ == "__main__":
    main()

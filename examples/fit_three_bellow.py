"""Fit the robot tue_three_bellow to its recorded runs, and show how well it explains them.

    python examples/fit_three_bellow.py DATA_FOLDER [--output PNG]

DATA_FOLDER holds forced_p123.csv and release_17deg.csv. Two fits are made: on the first 12 s and the release,
which leaves the rest as an honest judge, and on everything, which is what the shipped file holds.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from soro_core import SoftArm, load_robot
from soro_core.identification import (
    Fit,
    ForcedRun,
    MeasurementFrame,
    Parameter,
    ReleaseRun,
    curvature_errors,
    fit,
    fit_frame,
    forced_curvature,
    read_forced,
    read_release,
    release_bend,
)
from soro_core.robot import Robot

FRAME_UNTIL_S = 12.0
# Errors that are expected of the model; beyond them the loss grows only linearly.
CURVATURE_SCALE = 0.15
BEND_SCALE = math.radians(0.3)

# Fixed, because curvatures and a release cannot show them. The authors give the ratio of axial gain to axial
# stiffness; the level follows from a moment arm that fits inside the section. Viscous damping stays as in the
# file: fitted, it falls to nothing, since the creep branch carries the losses.
MOMENT_ARM_M = 0.008
AXIAL_LAW = (223.4, 174.0, 45.55)
AXIAL_GAIN = 2.34e-7
BENDING_RATE = 3.0

PARAMETERS = (
    Parameter("alpha_kappa", 1.2e-8, 1e-9, 1e-7),
    Parameter("area_slope", -4.0, -20.0, 5.0),
    Parameter("gain_1", 1.0, 0.7, 1.3),
    Parameter("gain_2", 1.0, 0.7, 1.3),
    Parameter("k_b_rest", 6e-3, 1e-3, 5e-2),
    Parameter("k_b_rise", 5e-4, 1e-6, 2e-2),
    Parameter("creep_stiffness", 2.2e-5, 0.0, 2e-4),
    Parameter("creep_tau", 0.025, 0.005, 0.2),
)


def build(values: Mapping[str, float]) -> Robot:
    """The robot of a set of parameters; what is not fitted comes from the shipped file."""
    shipped = load_robot("tue_three_bellow")
    link = shipped.links[0].model_dump(exclude_unset=True)
    alpha_eps = values["alpha_kappa"] / MOMENT_ARM_M
    axial = alpha_eps / AXIAL_GAIN
    gains = (1.0, values["gain_1"], values["gain_2"])
    link.update(
        k_e=(AXIAL_LAW[0] * axial, AXIAL_LAW[1] * axial, AXIAL_LAW[2]),
        k_b=(values["k_b_rest"] + values["k_b_rise"], values["k_b_rise"], BENDING_RATE),
        creep=[{"tau": [values["creep_tau"]], "stiffness": [0.0, *[values["creep_stiffness"]] * 2]}],
        chambers=[
            {
                "angle_rad": 2 * math.pi * i / 3,
                "alpha_eps": alpha_eps * gain,
                "alpha_kappa": values["alpha_kappa"] * gain,
                "area_slope": values["area_slope"],
            }
            for i, gain in enumerate(gains)
        ],
    )
    return shipped.replace(links=[link])


def identify(forced: ForcedRun, release: ReleaseRun) -> Fit:
    """Fit all parameters to a forced run and a release; the frame is fitted inside, on the first 12 s."""

    def residuals(values: Mapping[str, float]) -> np.ndarray:
        arm = SoftArm(build(values))
        t, simulated = forced_curvature(arm, forced)
        measured = forced.curvature_at(t)
        first = t < FRAME_UNTIL_S
        frame = fit_frame(measured[first], simulated[first], outlier_scale=CURVATURE_SCALE)
        curvature = ((frame.apply(simulated) - measured) / CURVATURE_SCALE).ravel()
        t_release, bend = release_bend(arm, release.bend[0], float(release.t[-1]), dt=2e-3)
        swing = (bend - np.interp(t_release, release.t, release.bend)) / BEND_SCALE
        # Both runs weigh the same, however many samples each has.
        return np.concatenate([curvature, swing * math.sqrt(len(curvature) / len(swing))])

    return fit(PARAMETERS, residuals, max_iterations=40)


def judge(
    robot: Robot, forced: ForcedRun, release: ReleaseRun
) -> tuple[dict[str, float], MeasurementFrame, dict[str, np.ndarray]]:
    """Errors of a robot on both runs, the frame fitted on the first 12 s only, and traces for the picture."""
    arm = SoftArm(robot)
    t, simulated = forced_curvature(arm, forced, dt=0.01)
    measured = forced.curvature_at(t)
    first = t < FRAME_UNTIL_S
    frame = fit_frame(measured[first], simulated[first])
    errors = {}
    for label, part in (("0-12 s", first), ("12-24 s", ~first)):
        found = curvature_errors(measured[part], simulated[part], frame.rotation, frame.offset)
        errors[f"vector {label} [1/m]"], errors[f"magnitude {label} [1/m]"] = found.vector, found.magnitude
    t_release, bend = release_bend(arm, release.bend[0], float(release.t[-1]))
    error = np.degrees(bend - np.interp(t_release, release.t, release.bend))
    errors["release [deg]"] = float(np.sqrt(np.mean(error**2)))
    traces = {
        "t": t,
        "measured": measured,
        "shown": frame.apply(simulated),
        "t_release": t_release,
        "bend": bend,
    }
    return errors, frame, traces


def picture(path: Path, forced: ForcedRun, release: ReleaseRun, traces: dict[str, np.ndarray]) -> None:
    """Measured against modelled: curvatures over time, loops, release."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 2, figsize=(13, 9), layout="constrained")
    over_time, loops, pressures, swing = axes.ravel()
    for column, name in enumerate(("kx", "ky")):
        over_time.plot(
            traces["t"], traces["measured"][:, column], color=f"C{column}", label=f"{name} measured"
        )
        over_time.plot(
            traces["t"], traces["shown"][:, column], "k--", lw=0.8, label="model" if column else None
        )
    over_time.axvline(FRAME_UNTIL_S, color="0.6")
    over_time.set(xlabel="t [s]", ylabel="curvature [1/m]", title="frame fitted left of the line")
    over_time.legend()
    loops.plot(*traces["measured"].T, label="measured")
    loops.plot(*traces["shown"].T, "k--", lw=0.8, label="model")
    loops.set(xlabel="kx [1/m]", ylabel="ky [1/m]", aspect="equal")
    loops.legend()
    pressures.plot(forced.t, forced.pressure / 1e3)
    pressures.set(xlabel="t [s]", ylabel="chamber pressure [kPa]")
    swing.plot(release.t, np.degrees(release.bend), label="measured")
    swing.plot(traces["t_release"], np.degrees(traces["bend"]), "k--", lw=0.8, label="model")
    swing.set(xlabel="t [s]", ylabel="bending angle [deg]", title="release")
    swing.legend()
    figure.savefig(path, dpi=110)


def main() -> None:
    """Fit twice, print, draw."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path, help="folder with forced_p123.csv and release_17deg.csv")
    parser.add_argument("--output", type=Path, default=Path("fit_three_bellow.png"))
    arguments = parser.parse_args()
    forced = read_forced(arguments.data / "forced_p123.csv")
    release = read_release(arguments.data / "release_17deg.csv")

    columns = {"shipped file": load_robot("tue_three_bellow")}
    for label, run in (("fit on 0-12 s", forced.window(0.0, FRAME_UNTIL_S)), ("fit on 0-24 s", forced)):
        found = identify(run, release)
        print(f"\n{label} and release: {found.evaluations} simulations, {found.message}")
        for name, value in found.values.items():
            print(f"  {name:16s} {value:12.5g}  +- {found.deviations[name]:.2g}")
        columns[label] = build(found.values)

    judged = {label: judge(robot, forced, release) for label, robot in columns.items()}
    print("\n" + " " * 26 + "".join(f"{label:>16s}" for label in judged))
    rows = next(iter(judged.values()))[0]
    for row in rows:
        print(f"{row:26s}" + "".join(f"{errors[row]:16.3f}" for errors, _, _ in judged.values()))
    print(
        f"{'frame rotation [rad]':26s}"
        + "".join(f"{frame.rotation:16.4f}" for _, frame, _ in judged.values())
    )
    for axis in range(2):
        cells = "".join(f"{frame.offset[axis]:16.3f}" for _, frame, _ in judged.values())
        print(f"{'offset k' + 'xy'[axis] + ' [1/m]':26s}{cells}")
    picture(arguments.output, forced, release, judged["shipped file"][2])
    print(f"\npicture of the shipped robot: {arguments.output}")


if __name__ == "__main__":
    main()

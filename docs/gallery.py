"""`make gallery`: run every shipped scene in lockstep, draw it, and write gallery.md from the scenes.

`python -m docs.gallery NAME ...` runs these alone.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

from soro_lab.scene import Scene
from soro_lab.scene.load import scenes_in, shipped_folder
from soro_ros.pictures import film, panels
from soro_ros.recordings import report
from soro_ros.recordings.bodies.tracks import tracks_of

HERE = Path(__file__).parent
PICTURES = HERE / "images" / "gallery"
PAGE = HERE / "gallery.md"
WIDTH_PX = 1080
# Colours of a picture; fewer where it would be too large.
COLOURS = (200, 80, 32, 16)
# Part of the width of a film that shows the arm.
ARM_PART = 0.56
MOST_BYTES = 60_000
# Lines that a legend names: it would cover the plot.
MOST_NAMES = 12
# A path whose width is a smaller part of its length is a line from above: pressures are drawn in its place.
FLAT = 0.1

HEADER = """# Scene gallery

Each [scene](README.md) is a file to run, read and change; its first comment says more.

    soro scenes                                      # name and purpose of each
    soro run set_points                              # in real time; --set mode=lockstep: without deadlines
    mkdir my_scenes
    soro scenes set_points > my_scenes/mine.yaml     # a copy to change
    soro scenes --folder my_scenes

Pictures: the arm at the end (colours: pressures; grey: reference of the tip; red: its path), the true tip
from above, pressures or force, distance from the reference. Below: verdict, RMS tip error of the last 5 s.
"""


def run(scene: Scene, folder: Path) -> tuple[Path, dict[str, Any]]:
    """Run a scene in lockstep; return the folder of the run, and its figures."""
    command = [sys.executable, "-m", "soro_ros.cli", "run", scene.name, "--set", "mode=lockstep"]
    subprocess.run([*command, "--folder", str(folder / scene.name)], check=False)
    (found,) = (folder / scene.name).iterdir()
    figures = json.loads((found / "summary.json").read_text())
    if figures["verdict"] != scene.verdict.expected:
        sys.exit(f"{scene.name}: {figures['verdict']}: {figures['reason']}")
    return found, figures


def view(shown: film.Take) -> panels.View:
    """Return what the panels of pictures draw."""
    return panels.View(shown.recording, shown.scene, 0.0, shown.scene.duration_s, "true")


def draw_pressures(axis: Any, shown: film.Take) -> None:
    """Draw readings and set points over time."""
    panels.draw_pressures(axis, view(shown))
    axis.set(xlabel="time [s]", xlim=(0.0, shown.scene.duration_s))
    axis.grid(alpha=0.3)


def draw_force(axis: Any, shown: film.Take) -> None:
    """Draw the force at the tip over time: estimated, true (pale) and wanted (dashed)."""
    panels.draw_force(axis, view(shown))
    axis.set(xlabel="time [s]", title="force at the tip", xlim=(0.0, shown.scene.duration_s))
    axis.grid(alpha=0.3)


def draw_error(axis: Any, shown: film.Take) -> None:
    """Draw the distance of the tip from its reference over time."""
    t, error = report.tip_error(shown.recording, shown.scene.duration_s)
    axis.plot(t, 1e3 * error, color="C3", lw=1.0, label="true tip to reference")
    axis.set(xlabel="time [s]", ylabel="distance [mm]", title="tip error", ylim=(0.0, None))
    axis.set_xlim(0.0, shown.scene.duration_s)
    axis.grid(alpha=0.3)


def draw(scene: Scene, run_folder: Path) -> None:
    """Draw the arm of a run, the path of its tip, and its error or its pressures, small enough for a page."""
    file, bag = PICTURES / f"{scene.name}.png", run_folder / "bag"
    bodies = list(tracks_of(bag, scene, f"/{scene.each[0].name}/arm/desired/tip").values())
    shown, *others = (
        film.with_carried(
            film.take(bag, arm, 0.0, scene.duration_s, 10.0, bodies), bag, scene.carried_by(arm), 10.0
        )
        for arm in scene.each
        if not arm.mounted_on
    )
    pictures = [film.AnimatedFigure(one, 800).at(len(one.t) - 1) for one in (shown, *others)]
    beside = np.hstack([one[:, : int(ARM_PART * one.shape[1])] for one in pictures])
    figure = plt.figure(figsize=(12.0, 3.8), layout="constrained")
    left, right = figure.subfigures(1, 2, width_ratios=(1.0, 2.0))
    drawn, axes = left.add_axes((0.0, 0.0, 1.0, 1.0)), right.subplots(1, 2)
    drawn.imshow(beside)
    drawn.axis("off")
    wanted = report.within(shown.recording.wanted_tip, scene.duration_s).value
    across = np.ptp(wanted[:, :2], axis=0)
    if shown.recording.wanted_force.t.size or scene.twin.wrench.at_s:
        draw_force(axes[0], shown)
    elif across.min() > FLAT * across.max():
        panels.draw_path(axes[0], view(shown))
    else:
        draw_pressures(axes[0], shown)
    if scene.verdict.expected == "vented":
        draw_pressures(axes[1], shown)
    else:
        draw_error(axes[1], shown)
    for axis in axes:
        if len(axis.get_legend_handles_labels()[0]) > MOST_NAMES:
            continue
        axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.17), ncols=2, fontsize="small")
    figure.savefig(file, dpi=WIDTH_PX / 12.0)
    plt.close(figure)
    pixels = Image.open(file).convert("RGB")
    for colours in COLOURS:
        pixels.quantize(colours, dither=Image.Dither.NONE).save(file, optimize=True)
        if file.stat().st_size <= MOST_BYTES:
            return
    sys.exit(f"{file}: {file.stat().st_size} bytes, more than {MOST_BYTES}")


def section(scene: Scene, figures: dict[str, Any]) -> str:
    """Return the part of the page on one scene."""
    what = f"{scene.description[0].upper()}{scene.description[1:]}."
    result = f"`{figures['verdict']}`"
    arms = figures.get("arms", {"": figures})
    errors = [one.get("tip_error_last_rms_m") for one in arms.values()]
    bodies = figures.get("bodies", {}).values()
    if left := [one["effort_part"] for one in bodies if one.get("effort_part") is not None]:
        result += f": {max(left):.1%} of the wearer's torque left"
    elif figures["verdict"] == "good" and None not in errors:
        error = max(errors)
        part = error / scene.each[errors.index(error)].loaded_robot.length
        result += f": {1e3 * error:.2f} mm, {part:.1%}"
    elif figures["reason"]:
        result += f": {figures['reason']}"
    picture = f"![{scene.name}](images/gallery/{scene.name}.png)"
    file = f"[More](../config/scenes/{scene.name}.yaml)"
    return f"## {scene.name}\n\n{what}\n\n{picture}\n\n{result}. {file}.\n"


def main(names: Sequence[str] = ()) -> None:
    """Run, draw and write; of given scenes alone, and the others stay."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    if unknown := set(names) - {scene.name for scene in scenes_in(shipped_folder()).scenes}:
        sys.exit(f"{', '.join(sorted(unknown))}: no shipped scene; `soro scenes` names them")
    written = {text.split("\n", 1)[0]: f"## {text}" for text in PAGE.read_text("utf-8").split("\n## ")[1:]}
    parts = [HEADER]
    with tempfile.TemporaryDirectory() as folder:
        for scene in scenes_in(shipped_folder()).scenes:
            if names and scene.name not in names:
                parts.append(written[scene.name].rstrip("\n") + "\n")
                continue
            run_folder, figures = run(scene, Path(folder))
            draw(scene, run_folder)
            parts.append(section(scene, figures))
    PAGE.write_text("\n".join(parts), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])

"""Picture of a run: tip path, tip error, pressures, parameter estimates."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from soro_core.scene import Scene
from soro_ros import shadow_report
from soro_ros.recording import Recording
from soro_ros.report import WINDOW_S, Array, read_run, tip_error, within


def draw(bag: Path, scene: Scene, file: Path) -> None:
    """Draw the run: tip and reference, error, pressures, parameter estimates.

    Parameters
    ----------
    bag : Path
        Folder of the bag.
    scene : Scene
        Scene of the run.
    file : Path
        File of the picture.
    """
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    recording = read_run(bag, scene)
    t, error = tip_error(recording, scene.duration_s)
    kind = "measured" if scene.arm == "real" else "true"
    beside = recording.shadow.t.size > 0
    rows = 3 if beside else 2
    figure, axes = plt.subplots(rows, 2, figsize=(12, 5 * rows), layout="constrained")
    draw_path(axes[0, 0], recording, scene.duration_s, kind)
    _draw_error(axes[0, 1], t, error, recording, kind)
    draw_pressures(axes[1, 0], recording, scene)
    draw_estimates(axes[1, 1], recording)
    if beside:
        shadow_report.draw(axes[2], recording.shadow, scene.shadow.tolerance_m)
    for axis in axes.flat[1:]:
        axis.set_xlabel("time [s]")
        axis.set_xlim(0, scene.duration_s)
        axis.grid(alpha=0.3)
    for axis in axes.flat:
        if axis.get_legend_handles_labels()[0]:  # below, where it lies over no data
            axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2, fontsize="small")
    adaptation = "on" if scene.controller.adapt else "off"
    what = "real arm" if scene.arm == "real" else f"payload {_payload(scene)}"
    figure.suptitle(f"{scene.name}: {scene.robot}, {what}, adaptation {adaptation}")
    figure.savefig(file, dpi=110)
    plt.close(figure)


def _payload(scene: Scene) -> str:
    """Return the payload, and each later one with its time."""
    changes = scene.twin.payload_changes
    later = zip(changes.payload_kg, changes.at_s, strict=True)
    return ", ".join(
        [f"{scene.twin.payload_kg * 1e3:g} g", *(f"{mass * 1e3:g} g from {t:g} s" for mass, t in later)]
    )


def draw_path(axis: object, recording: Recording, duration_s: float, kind: str) -> None:
    """Draw the path of the tip and its reference from above.

    Parameters
    ----------
    axis : matplotlib.axes.Axes
        Where it is drawn.
    recording : Recording
        The run.
    duration_s : float
        Time under control [s].
    kind : str
        Of the tip: true or measured.
    """
    true, wanted = within(recording.true_tip, duration_s), within(recording.wanted_tip, duration_s)
    axis.plot(*(wanted.value[:, :2] * 1e3).T, color="0.6", lw=3, label="reference")
    axis.plot(*(true.value[:, :2] * 1e3).T, color="C0", lw=0.8, label=f"{kind} tip")
    late = true.t >= duration_s - WINDOW_S
    if late.any():
        label = f"{kind} tip, last {WINDOW_S:g} s"
        axis.plot(*(true.value[late, :2] * 1e3).T, color="C3", lw=1.4, label=label)
    axis.set(xlabel="x [mm]", ylabel="y [mm]", title="tip path, seen along the base's axis", aspect="equal")
    axis.grid(alpha=0.3)


def _draw_error(axis: object, t: Array, error: Array, recording: Recording, kind: str) -> None:
    axis.plot(t, error * 1e3, color="C0", lw=0.8, label=f"{kind} tip to reference")
    if recording.estimated_tip.t.size:
        off = np.linalg.norm(recording.estimated_tip.at(t) - recording.true_tip.at(t), axis=1)
        axis.plot(t, off * 1e3, color="C2", lw=0.8, label=f"estimated tip to {kind} tip")
    axis.set(ylabel="distance [mm]", title="tip error", ylim=(0, None))


def draw_pressures(axis: object, recording: Recording, scene: Scene) -> None:
    """Draw readings, set points and limits.

    Parameters
    ----------
    axis : matplotlib.axes.Axes
        Where it is drawn.
    recording : Recording
        The run.
    scene : Scene
        Its limits.
    """
    for k, name in enumerate(recording.reading.names):
        axis.plot(
            recording.reading.t,
            recording.reading.value[:, k] / 1e3,
            color=f"C{k}",
            lw=0.8,
            label=f"{name} measured",
        )
    for k in range(recording.command.value.shape[1]):
        axis.plot(recording.command.t, recording.command.value[:, k] / 1e3, color=f"C{k}", lw=0.5, alpha=0.4)
    for bound in (scene.limits.minimum_pa, scene.limits.maximum_pa):
        axis.axhline(bound / 1e3, color="0.3", ls="--", lw=0.8)
    axis.set(ylabel="gauge pressure [kPa]", title="pressures (pale: set points; dashed: limits)")


def draw_estimates(axis: object, recording: Recording) -> None:
    """Draw the parameter estimates, each over its first value."""
    series = recording.estimates
    weights = [k for k, name in enumerate(series.names) if "/offset" in name or "/by " in name]
    for k in weights:  # W of a learned force: too many for a legend
        label = "entries of W" if k == weights[0] else None
        axis.plot(series.t, series.value[:, k], color="0.6", lw=0.5, label=label)
    for k, name in enumerate(series.names):
        if k in weights:
            continue
        values = series.value[:, k]
        largest = float(np.max(np.abs(values))) or 1.0
        # What starts from (almost) nothing, as an unknown load does, is shown against its largest value.
        scale, what = (abs(values[0]), "start") if abs(values[0]) > 0.01 * largest else (largest, "largest")
        unit = " kg" if name.endswith("mass") else ""
        label = f"{name} / {scale:.3g}{unit} ({what}), end {values[-1]:.3g}{unit}"
        axis.plot(series.t, values / scale, lw=1.0, label=label)
    axis.set(ylabel="estimate, scaled", title="parameter estimates", ylim=(None if weights else 0, None))

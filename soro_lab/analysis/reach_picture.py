"""The picture of `soro reach`: resting places with the tip's compliance, frequencies, shapes of modes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from soro_core.arrays import Array
from soro_core.control.reachable_workspace import Reachable
from soro_core.model import SoftArm
from soro_core.robot.coordinates import strain_fields
from soro_lab.analysis.equilibrium_paths import EquilibriumPath, RestingPlace
from soro_lab.analysis.modes import LinearisedModes

# Largest ellipse and largest displacement of a mode, parts of the length of the arm.
_ELLIPSE, _MODE = 0.1, 0.15
_COLOURS = matplotlib.colormaps["tab10"]
# Share of a strain field that is named.
_NAMED = 0.05
# Frequencies below this part of the largest one are 0 but for round-off.
FREE = 2e-5


def draw(
    path: Path, arm: SoftArm, found: Reachable, ways: Sequence[EquilibriumPath], count: int, title: str
) -> None:
    """Write the picture as PNG.

    Parameters
    ----------
    path : Path
    arm : SoftArm
        Model, with its load.
    found : Reachable
    ways : sequence of EquilibriumPath
        From rest through the range of the pressures.
    count : int
        Number of modes.
    title : str
    """
    rest = ways[0].places[0]
    chosen = rest.modes.dominant(count)
    figure = Figure(figsize=(12.0, 10.5), layout="constrained")
    parts: Any = figure.subfigures(2, 1, height_ratios=(1.15, 1.0))
    top, below = parts
    _places(top, arm, found, ways)
    left, right = below.subfigures(1, 2, width_ratios=(1.0, max(1.0, 0.36 * len(chosen))))
    _frequencies(left.subplots(), ways, chosen)
    _shapes(right, arm, rest, chosen)
    figure.suptitle(title)
    figure.savefig(path, dpi=110)


def displacement_force(arm: SoftArm, places: Sequence[RestingPlace]) -> float:
    """Force [N], a round number, that displaces the tip by no more than the largest ellipse anywhere."""
    softest = [place.tip.stiffness[place.tip.stiffness > _ELLIPSE][:1] for place in places]
    stiffness = min((float(one[0]) for one in softest if one.size), default=1.0)
    size = _ELLIPSE * arm.length * stiffness
    decade = 10.0 ** math.floor(math.log10(size))
    return decade * max(step for step in (1.0, 2.0, 5.0) if step * decade <= size * (1.0 + 1e-9))


def ellipse(compliance: Array, force_n: float, axes: tuple[int, int]) -> Array:
    """Outline (2, n) [m] of the displacements by a force of any direction, seen along one axis.

    Parameters
    ----------
    compliance : ndarray (3, 3)
        [m/N].
    force_n : float
    axes : tuple of int
        The two axes that are seen.
    """
    seen = compliance[list(axes)] * force_n
    values, vectors = np.linalg.eigh(seen @ seen.T)
    around = np.linspace(0.0, 2.0 * np.pi, 73)
    circle = np.stack([np.cos(around), np.sin(around)])
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))) @ circle)


def _places(figure: Any, arm: SoftArm, found: Reachable, ways: Sequence[EquilibriumPath]) -> None:
    """Places of the tip from the side and from above, with ellipses of compliance."""
    side, above = figure.subplots(1, 2)
    mean_kpa = 1e-3 * found.pressure_pa.mean(axis=1)
    order = np.argsort(mean_kpa)
    tips = found.tip_m
    farthest = {int(k) for k in (*tips.argmin(axis=0), *tips.argmax(axis=0))}
    shown = [ways[0].places[0], *(way.places[-1] for way in ways)]
    force = displacement_force(arm, shown)
    for axes, (i, j) in ((side, (0, 2)), (above, (0, 1))):
        for k in sorted(farthest):
            x = 1e3 * arm.backbone(found.q[k])
            axes.plot(x[:, i], x[:, j], color="0.8", lw=2, zorder=1)
        dots = axes.scatter(1e3 * tips[order, i], 1e3 * tips[order, j], c=mean_kpa[order], s=6, zorder=2)
        for n, place in enumerate(shown):
            if place.tip.stiffness[0] <= _ELLIPSE:  # free to turn about the vertical
                continue
            colour = "black" if n == 0 else _COLOURS((n - 1) % 10)
            outline = 1e3 * (place.tip_m[[i, j], None] + ellipse(place.tip.compliance, force, (i, j)))
            axes.plot(*outline, color=colour, lw=1.5, zorder=4)
        axes.plot(1e3 * found.rest_m[i], 1e3 * found.rest_m[j], "k+", ms=10, zorder=3)
        axes.set_xlabel(f"{'xyz'[i]}, mm")
        axes.set_ylabel(f"{'xyz'[j]}, mm")
        axes.set_aspect("equal", adjustable="datalim")
        axes.grid(True, alpha=0.3)
    side.set_title("from the side; grey: shapes at the farthest places", fontsize=9)
    above.set_title(
        f"from above; +: lowest pressures\nellipses: where {1e3 * force:g} mN in any direction move the tip "
        "(black: at rest; others: colours as below)",
        fontsize=9,
    )
    figure.colorbar(dots, ax=above, label="mean pressure, kPa")


def _frequencies(axes: Any, ways: Sequence[EquilibriumPath], chosen: Sequence[int]) -> None:
    """Frequencies of the drawn modes over the pressures."""
    for n, way in enumerate(ways):
        free = np.array([place.modes.frequency_hz[chosen] for place in way.places])
        swing = np.array([place.modes.damped_hz[chosen] for place in way.places])
        swing[swing == 0.0] = np.nan
        free[free < FREE * way.places[0].modes.frequency_hz.max()] = np.nan
        x, colour, end = 1e-3 * way.pressure_pa, _COLOURS(n % 10), "" if way.reached else ", no rest beyond"
        axes.plot(x, swing, color=colour, lw=1.5)
        axes.plot(x, free, color=colour, lw=1.0, ls=":")
        axes.plot([], [], color=colour, label=f"{way.name} to {x[-1]:g} kPa{end}")
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter("{x:g}")
    low, high = axes.get_ylim()
    axes.set_ylim(low, high * (high / low) ** 0.3)  # room for the legend
    if high < 20.0 * low:  # too few decades alone
        axes.yaxis.set_minor_formatter("{x:g}")
        axes.tick_params(axis="y", which="minor", labelsize=7)
    axes.set_xlabel("pressure of the chambers that are named, the others at rest, kPa")
    axes.set_ylabel("frequency, Hz")
    axes.set_title("frequencies of the modes: with losses (lines), without (dots)", fontsize=9)
    axes.grid(True, which="both", alpha=0.25)
    axes.legend(fontsize=8, loc="upper left", ncols=2)


def _shapes(figure: Any, arm: SoftArm, rest: RestingPlace, chosen: Sequence[int]) -> None:
    """The dominant modes at rest, each in the vertical plane of its largest motion."""
    panels = figure.subplots(1, len(chosen), sharex=True, sharey=True, squeeze=False)[0]
    figure.suptitle("modes at rest with most of the compliance of the tip; black: rest", fontsize=9)
    still = arm.backbone(rest.q)
    for axes, k in zip(panels, chosen, strict=True):
        step = rest.modes.shapes[:, k]
        motion = (arm.backbone(rest.q + 1e-4 * step / np.abs(step).max()) - still) * np.abs(step).max() / 1e-4
        farthest = int(np.argmax(np.linalg.norm(motion, axis=1)))
        level = motion[farthest, :2]
        sideways = np.linalg.norm(level) > 1e-3 * np.linalg.norm(motion[farthest])
        across = level / np.linalg.norm(level) if sideways else np.array([1.0, 0.0])
        across = across * np.sign(across[np.argmax(np.abs(across))]) + 0.0
        size = _MODE * arm.length / np.linalg.norm(motion[farthest])
        for part, colour in ((1.0, "tab:red"), (-1.0, "tab:blue"), (0.0, "black")):
            x = 1e3 * arm.backbone(rest.q + part * size * step)
            level_mm, width = x[:, :2] @ across, 2.0 if part == 0.0 else 1.5
            axes.plot(level_mm, x[:, 2], color=colour, lw=width)
            axes.plot(level_mm[-1], x[-1, 2], "o", color=colour, ms=5)  # seen where the lines are one
        axes.set_aspect("equal", adjustable="box")
        axes.set_title(_caption(arm, rest, k), fontsize=8)
        angle = round(math.degrees(math.atan2(across[1], across[0])))
        axes.set_xlabel(f"along {angle + 0.0:.0f}° from x, mm", fontsize=8)
        axes.grid(True, alpha=0.3)
    panels[0].set_ylabel("z, mm")


def _caption(arm: SoftArm, rest: RestingPlace, k: int) -> str:
    """Frequency, damping, share of the compliance of the tip and of the strains of one mode."""
    modes = rest.modes
    swing = f"{modes.damped_hz[k]:.3g} Hz" if modes.damped_hz[k] else "no swing"
    lines = [f"mode {k + 1}: {frequency(modes, k)} Hz", f"with losses {swing},"]
    lines += [
        f"damping ratio {modes.damping_ratio[k]:.2f}",
        f"{100 * modes.tip_share[k]:.0f} % of the compliance",
    ]
    shares = strain_shares(arm, modes.strain_share[k])
    lines += [f"{name} {100 * part:.0f} %" for name, part in shares.items() if part >= _NAMED]
    return "\n".join(lines)


def frequency(modes: LinearisedModes, k: int) -> str:
    """Return a frequency [Hz] in three digits, 0 where the arm is free to turn."""
    free = modes.frequency_hz[k] < FREE * modes.frequency_hz.max()
    return "0" if free else f"{modes.frequency_hz[k]:.3g}"


def strain_shares(arm: SoftArm, share: Array) -> dict[str, float]:
    """Return the share of each strain in a mode, over all links, from those of the fields (n_fields,)."""
    names = strain_fields(arm.robot).strains
    return {
        name: float(sum(part for one, part in zip(names, share, strict=True) if one == name))
        for name in dict.fromkeys(names)
    }

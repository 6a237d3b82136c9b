"""From the states of a part to its robot: single loads, all together, errors, modes, mesh."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from soro_core.arrays import Array
from soro_core.config import with_changes
from soro_core.robot import Robot
from soro_design.parts.file import LoadSweep, PartFile
from soro_design.parts.geometry import PneunetGeometry, RodGeometry
from soro_design.parts.specimen import RodSpecimen, make_specimen
from soro_design.parts.sweeps import backbone, follow
from soro_design.robot_of_part.direct import Direct, direct
from soro_design.robot_of_part.joint import TipError, refine, tip_errors
from soro_design.robot_of_part.link import Template, robot_of, template
from soro_design.robot_of_part.modes import Kept, kept, modes, samples_of, strain_keys
from soro_design.robot_of_part.snapshots import Snapshots
from soro_lab.identification.fit import Fit

# Modes that the report compares.
MOST_MODES = 3


@dataclass(frozen=True)
class MeshCheck:
    """A sweep on a mesh of half as many elements a way.

    Attributes
    ----------
    sweep : str
        Its name.
    elements, coarse_elements : int
        Of both meshes.
    difference : float
        Distance of the tips at the end of the sweep over the length.
    motion : float
        How far the tip has moved then, over the length.
    """

    sweep: str
    elements: int
    coarse_elements: int
    difference: float
    motion: float

    @property
    def error(self) -> float:
        """What second order leaves on the finer mesh: a third of the difference."""
        return self.difference / 3.0

    @property
    def of_motion(self) -> float:
        """The same over how far the tip has moved."""
        return self.error / self.motion


@dataclass(frozen=True, eq=False)
class PartIdentification:
    """What was found.

    Attributes
    ----------
    data : Snapshots
        The states.
    known : Template
        What the part says of the link.
    start : Direct
        Numbers by single loads.
    fit : Fit
        Numbers by all states.
    robot : Robot
        With these numbers.
    samples : mapping of str to ndarray or None
        Modes of the robot, None where its strains are constant.
    fitted, held_out : list of TipError
        Of the states of the fit, and of those that judge it.
    constant : list of TipError or None
        Of the held-out states with constant strain, where the robot has modes.
    kept : tuple of tuple of Kept
        What constant strains, one mode, two modes ... keep of the fitted and of the held-out states.
    mesh : MeshCheck or None
        None where it was left out.
    strength : tuple of str
        Lines on what the part asks of its material.
    has_stiff_tendon : bool
        Whether a tendon of the part is fixed along it.
    """

    data: Snapshots
    known: Template
    start: Direct
    fit: Fit
    robot: Robot
    samples: Mapping[str, Array] | None
    fitted: list[TipError]
    held_out: list[TipError]
    constant: list[TipError] | None
    kept: tuple[tuple[Kept, Kept], ...]
    mesh: MeshCheck | None = None
    strength: tuple[str, ...] = ()
    has_stiff_tendon: bool = False

    @property
    def values(self) -> Mapping[str, float]:
        """Numbers of the link."""
        return self.fit.values

    @property
    def is_interrupted(self) -> bool:
        """Whether Ctrl-C ended the fit; the numbers are the best until then."""
        return self.fit.message == "interrupted"


def identify(
    file: PartFile,
    specimen: RodSpecimen,
    data: Snapshots,
    name: str,
    n_modes: int = 0,
    progress: Callable[[str], None] = lambda stage: None,
) -> PartIdentification:
    """Find the numbers of a link that stands for a rod.

    Parameters
    ----------
    file : PartFile
    specimen : RodSpecimen
        Its mesh.
    data : Snapshots
        Its states.
    name : str
        Of the robot.
    n_modes : int
        Modes of each strain; 0 for constant strains.
    progress : callable
        Called with the name of each stage.
    """
    shape = file.geometry.shape if isinstance(file.geometry, PneunetGeometry) else None
    start = direct(data, shape.chamber_area_m2 if shape else None)
    known = template(file, specimen, name, start)
    pressed = data.fitted
    progress("modes")
    found = modes(data, pressed, MOST_MODES)
    compared = []
    for n in range(MOST_MODES + 1):
        basis = found if n else None
        compared.append((kept(data, pressed, basis, n), kept(data, data.held_out, basis, n)))
    samples, strains, constant = None, None, None
    if n_modes:
        progress("fit of constant strain")
        plain = robot_of(known, refine(data, known, start).values)
        constant = tip_errors(data, plain, data.held_out)
        samples = samples_of(data, modes(data, pressed, n_modes))
        strains = strain_keys(samples)
    progress("fit to all states")
    result = refine(data, known, start, strains)
    robot = robot_of(known, result.values, strains)
    progress("errors")
    fitted, held_out = (tip_errors(data, robot, states) for states in (pressed, data.held_out))
    return PartIdentification(
        data, known, start, result, robot, samples, fitted, held_out, constant, tuple(compared)
    )


def mesh_check(file: PartFile, specimen: RodSpecimen, data: Snapshots) -> MeshCheck | None:
    """Compute the sweep of the first uneven pressures on a coarser mesh.

    None if that has no solution, or if there is none: of a PneuNet whose walls have one element.

    Parameters
    ----------
    file : PartFile
    specimen : RodSpecimen
        Made of it.
    data : Snapshots
    """
    geometry = file.geometry
    assert isinstance(geometry, RodGeometry | PneunetGeometry)
    least = {"around": 2, "across": 1, "along": 1, "plug": 1, "between": 1}
    counts = {key: count for key, count in least.items() if key in type(geometry).model_fields}
    if isinstance(geometry, PneunetGeometry) and min(geometry.across, geometry.between) < 2:
        return None
    halved: dict[str, Any] = {key: max(count, getattr(geometry, key) // 2) for key, count in counts.items()}
    coarse = make_specimen(with_changes(file, geometry=with_changes(geometry, **halved)))
    assert isinstance(coarse, RodSpecimen)
    name = data.uneven[0].sweep
    sweep: LoadSweep = next(one for one in file.sweeps if one.name == name)
    done = follow(coarse, sweep, lambda state: None)
    fine = [state for state in data.uneven if state.sweep == name and state.load == done.last.load]
    if not fine or not done.states:
        return None
    tips = [state.poses[-1][:3, 3] for state in (backbone(coarse, sweep, done.last), fine[0])]
    elements, coarse_elements = (len(one.part.mesh.cells) for one in (specimen, coarse))
    apart = float(np.linalg.norm(tips[1] - tips[0]))
    return MeshCheck(name, elements, coarse_elements, apart / data.length, data.motion(fine[0]) / data.length)

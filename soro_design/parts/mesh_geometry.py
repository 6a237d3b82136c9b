"""The geometry of a part whose mesh is a file of another program: its regions, and what acts on which."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from soro_core.config import Floats, Strict, with_changes
from soro_design.fem.elements.mesh import Space

Between = Annotated[tuple[float, float], Field(strict=False)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$")]
AXES = {"plane_strain": "xy", "axisymmetric": "xy", "solid": "xyz"}


class Region(Strict):
    """Nodes of a mesh for which all that is stated holds; faces of a region have all their nodes in it.

    Of a closed surface inside the mesh a region has those faces alone.
    """

    group: Annotated[str, Field(description="a named set of the file; default: any")] = ""
    x_m: Annotated[
        Between | None, Field(description="least and greatest x, of a part about an axis its radius")
    ] = None
    y_m: Annotated[
        Between | None, Field(description="least and greatest y, of a part about an axis the place along it")
    ] = None
    z_m: Annotated[Between | None, Field(description="least and greatest z of a solid")] = None
    radius_m: Annotated[
        Between | None, Field(description="least and greatest distance from the z axis of a solid")
    ] = None

    inner_surface: Annotated[
        int | None, Field(ge=1, description="number of a closed surface inside the mesh; 1 has most air")
    ] = None
    around_m: Annotated[
        Floats | None, Field(description="a point in the air of a closed surface inside the mesh")
    ] = None
    stl: Annotated[
        str, Field(description="beside the part file, in unit_m: the surface of a cavity of a solid")
    ] = ""

    @model_validator(mode="after")
    def _stated(self) -> Region:
        if not (self.group or self.bounds() or self.has_surface):
            raise ValueError("a group, inner_surface, around_m, stl, or bounds: x_m, y_m, z_m, radius_m")
        for key, (low, high) in self.bounds().items():
            if low > high:
                raise ValueError(f"{key} from the least to the greatest (here {low:g}, {high:g})")
        return self

    @property
    def has_surface(self) -> bool:
        """Whether it has faces of its own: of a closed surface, or beside the air in an STL."""
        return self.inner_surface is not None or self.around_m is not None or bool(self.stl)

    def bounds(self) -> dict[str, tuple[float, float]]:
        """Least and greatest values [m] by key, of those that are stated."""
        stated = {key: getattr(self, key) for key in ("x_m", "y_m", "z_m", "radius_m")}
        return {key: value for key, value in stated.items() if value is not None}


class FixedNodes(Strict):
    """Nodes that do not move in some directions."""

    region: Annotated[Name, Field(description="its name in regions")]
    directions: Annotated[
        str, Field(pattern=r"^[xyz]+$", description="for example xyz; y of a part about an axis is along it")
    ]


class Pressed(Strict):
    """Faces that take one pressure of a sweep."""

    region: Annotated[Name, Field(description="its name in regions")]
    is_open: Annotated[
        bool, Field(description="whether they are an open surface; else they close a cavity")
    ] = False


class Moved(Strict):
    """Nodes that a sweep moves by its `extension_m`."""

    region: Annotated[Name, Field(description="its name in regions")]
    direction: Annotated[str, Field(pattern=r"^[xyz]$", description="of the motion")]


class MeshGeometry(Strict):
    """A mesh of a file (extra `design`; STEP and STL: extra `mesh`), and what acts where."""

    kind: Annotated[Literal["mesh"], Field(description="a mesh of a file")]
    file: Annotated[
        str,
        Field(
            min_length=1,
            description="beside the part file: .msh, .vtu, what else meshio reads; .step, .stl",
        ),
    ]
    space: Annotated[Space, Field(description="of a STEP file, solid")] = "solid"
    unit_m: Annotated[float, Field(gt=0.0, description="unit of the file; a STEP file states its own")] = 1.0
    largest_m: Annotated[
        float | None, Field(gt=0.0, description="greatest edge of the tetrahedra of a STEP or STL file")
    ] = None
    regions: Annotated[dict[Name, Region], Field(description="by name")]
    held: Annotated[tuple[FixedNodes, ...], Field(strict=False, description="what does not move")]
    pressed: Annotated[
        tuple[Pressed, ...], Field(strict=False, description="in the order of pressures_pa of a sweep")
    ] = ()
    forced: Annotated[str, Field(description="region whose faces take the force of a sweep")] = ""
    moved: Annotated[Moved | None, Field(description="region that extension_m of a sweep moves")] = None

    @property
    def is_step(self) -> bool:
        """Whether the file is a STEP file."""
        return self.file.lower().endswith((".step", ".stp"))

    @property
    def is_surface(self) -> bool:
        """Whether the file is an STL of the surface of a solid."""
        return self.file.lower().endswith(".stl") and self.space == "solid"

    def beside(self, part: Path) -> MeshGeometry:
        """Return it with the whole paths of its files, which lie beside a part file."""

        def whole(name: str) -> str:
            return str((part.parent / name).resolve())

        regions = {
            name: with_changes(one, stl=whole(one.stl)) if one.stl else one
            for name, one in self.regions.items()
        }
        return with_changes(self, file=whole(self.file), regions=regions)

    def named(self) -> dict[str, str]:
        """Regions that are used, by the key that uses them."""
        used = {f"held[{i}].region": one.region for i, one in enumerate(self.held)}
        used |= {f"pressed[{i}].region": one.region for i, one in enumerate(self.pressed)}
        if self.forced:
            used["forced"] = self.forced
        if self.moved is not None:
            used["moved.region"] = self.moved.region
        return used

    def directions(self) -> dict[str, str]:
        """Directions that are stated, by their keys."""
        stated = {f"held[{i}].directions": one.directions for i, one in enumerate(self.held)}
        if self.moved is not None:
            stated["moved.direction"] = self.moved.direction
        for name, region in self.regions.items():
            keys = region.bounds()
            if self.space != "solid" and "radius_m" in keys:
                stated[f"regions.{name}.radius_m"] = "z"
            if "z_m" in keys:
                stated[f"regions.{name}.z_m"] = "z"
        return stated

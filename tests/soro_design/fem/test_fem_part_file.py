"""Part files: what loads, and the one line for what does not."""

import numpy as np
import pytest

from soro_core.config import config_folder, read_yaml
from soro_design.parts.file import load_part, material_of
from soro_design.parts.specimen import RingSpecimen, RodSpecimen, make_specimen
from tests.refused import refused
from tests.soro_design.fem.small_parts import ROD, TUBE, written


@pytest.mark.parametrize("name", sorted(path.stem for path in (config_folder() / "parts").glob("*.yaml")))
def test_shipped_parts_have_meshes(name):
    part = load_part(name)
    if part.geometry.kind == "mesh":
        pytest.importorskip("meshio", reason="needs the extra design: pip install 'soro[design]'")
    if part.contact is not None:
        pytest.importorskip("ipctk", reason="needs the extra design: pip install 'soro[design]'")
    specimen = make_specimen(part)
    assert len(specimen.part.mesh.cells) > 100
    for sweep in part.sweeps:
        specimen.under(sweep)


def test_the_ratio_of_moduli_takes_the_place_of_poissons():
    part = load_part("silicone_rod_three_chambers")
    material = material_of(part)
    assert material.bulk_modulus_pa / material.shear_modulus_pa == pytest.approx(50.0, rel=1e-12)


def test_the_kind_decides_what_is_held(tmp_path):
    rod = make_specimen(load_part(written(tmp_path, ROD)))
    assert isinstance(rod, RodSpecimen)
    assert np.isfinite(rod.part.loads.held).all(axis=1).sum() == len(rod.rod.base)
    tube = make_specimen(load_part(written(tmp_path, TUBE)))
    assert isinstance(tube, RingSpecimen)
    assert (tube.part.mesh.points[tube.inside][:, :, 0] == 0.004).all()
    assert (tube.part.mesh.points[tube.tip, 1] == 0.02).all()


def test_bellows_may_end_in_tubes(tmp_path):
    file = load_part("printed_bellows")
    geometry = file.geometry.model_copy(update={"end_m": 4.1e-3})
    ring = make_specimen(file.model_copy(update={"geometry": geometry}))
    r, z = ring.part.mesh.points[ring.tip].T
    np.testing.assert_allclose(z, 64e-3)
    assert (r.min(), r.max()) == pytest.approx((2.8e-3, 3.6e-3))
    with refused("geometry"):
        make_specimen(file.model_copy(update={"geometry": geometry.model_copy(update={"end_m": -1e-3})}))


def with_geometry(**changes):
    return {"geometry": {**ROD["geometry"], **changes}}


def with_sweep(**changes):
    return {"sweeps": [{**ROD["sweeps"][0], **changes}]}


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"material": ""}, "material"),
        ({"colour": "blue"}, "colour"),
        ({"sweeps": []}, "sweeps"),
        ({"bulk_over_shear": 0.5}, "bulk_over_shear"),
        ({"material": "ninjaflex_85", "bulk_over_shear": "many"}, "bulk_over_shear"),
        (with_geometry(kind="sponge"), "geometry.kind"),
        (with_geometry(chamber_radius_m=0.0055), "geometry.chamber_radius_m"),
        (with_geometry(plug_m=0.05), "geometry.plug_m"),
        (with_geometry(around=1), "geometry.around"),
        (with_geometry(hoops={"stiffness_n": -1.0, "spacing_m": 1e-3}), "geometry.hoops.stiffness_n"),
        (with_sweep(pressures_pa=[1e3]), "sweeps[0].pressures_pa"),
        (with_sweep(pressures_pa=[0.0, 0.0, 0.0]), "sweeps[0]"),
        (with_sweep(extension_m=1e-3), "sweeps[0].extension_m"),
        (with_sweep(states=0), "sweeps[0].states"),
        (with_sweep(name="a/b"), "sweeps[0].name"),
        ({"sweeps": ROD["sweeps"] * 2}, "sweeps"),
    ],
)
def test_what_is_refused(tmp_path, changes, key):
    with refused(key):
        load_part(written(tmp_path, ROD, **changes))


def test_parts_about_an_axis_take_extensions(tmp_path):
    with refused("sweeps[0].force_n", names=("extension_m",)):
        load_part(written(tmp_path, TUBE, sweeps=[{"name": "pulled", "force_n": [0.0, 0.0, 1.0]}]))
    geometry = {**TUBE["geometry"], "outer_radius_m": 0.003}
    with refused("geometry.outer_radius_m"):
        load_part(written(tmp_path, TUBE, geometry=geometry))
    printed = {"material": "tpu_90", "bulk_over_shear": 10.0}
    load_part(written(tmp_path, TUBE, **printed))


BELLOWS = read_yaml(config_folder() / "parts" / "printed_bellows.yaml")


@pytest.mark.parametrize(
    ("part", "key", "value", "allowed"),
    [
        (ROD, "length_m", 0.0, "above 0"),
        (ROD, "radius_m", -0.012, "above 0"),
        (ROD, "chambers", 1, "2 to 12"),
        (ROD, "chamber_offset_m", 0.013, "0.012"),
        (ROD, "chamber_radius_m", 0.0055, "0.005"),
        (ROD, "plug_m", 0.05, "0.03"),
        (ROD, "around", 1, "2 or more"),
        (ROD, "across", 0, "1 or more"),
        (BELLOWS, "lobes", 0, "1 or more"),
        (BELLOWS, "pitch_m", -1.0, "above 0"),
        (BELLOWS, "fillet_m", 0.0, "above 0"),
        (BELLOWS, "lobe_width_m", 7e-3, "0.006975"),
        (BELLOWS, "wall_m", 2e-3, "0.0011"),
        (BELLOWS, "neck_radius_m", 1e-4, "0.0008"),
        (BELLOWS, "outer_radius_m", 5e-3, "0.0060375"),
    ],
)
def test_the_range_of_a_dimension_stands_in_its_line(tmp_path, part, key, value, allowed):
    """With its number where it depends on other keys."""
    geometry = {**part["geometry"], key: value}
    with refused(f"geometry.{key}", value, names=(allowed,)):
        load_part(written(tmp_path, part, geometry=geometry))


def test_no_sweeps_say_what_is_needed(tmp_path):
    with refused("sweeps", [], names=("one sweep or more",)):
        load_part(written(tmp_path, ROD, sweeps=[]))

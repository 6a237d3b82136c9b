"""A second, stiffer material: elements of it, where the iterations place it, and what is exported."""

from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from soro_core.errors import ModelError
from soro_design.fem import block, load_material, make_part, no_loads, read_stl, solve, strained
from soro_design.fem.elements.material import material_from_dict
from soro_design.fem.meshes.surface import volume
from soro_design.topology import load_state, make_domain, optimise, reanalyse, save, shape, task_from_dict
from soro_design.topology.check import stiff_cells
from soro_design.topology.optimise import filters
from soro_design.topology.task import write_task
from soro_ros.cli import application
from tests.refused import fails, refused
from tests.soro_design.topology.small import bellow

SIZE_M = (0.012, 0.036)
CHAMBER = {"kind": "box", "x_m": [0.004, 0.008], "y_m": [0.003, 0.033]}


def bender(**changes):
    """A bar with a chamber in its middle, all of it given: it bends as the second material lies."""
    data = {
        "size_m": list(SIZE_M),
        "cells": [12, 36],
        "goal": {
            "kind": "farthest",
            "material": "dragonskin_10",
            "poisson_ratio": 0.45,
            "output": {"kind": "box", "y_m": [SIZE_M[1], SIZE_M[1]]},
            "direction": [1.0, 0.0],
            "spring_pa": 100.0,
            "stiff": {"times": 10.0, "volume_fraction": 0.15},
        },
        "held": [{"where": {"kind": "box", "y_m": [0.0, 0.0]}, "along": ["x", "y"]}],
        "inlet": CHAMBER,
        "open": [{"kind": "box", "x_m": [x, x]} for x in (0.0, SIZE_M[0])],
        "solid": [
            {"kind": "box", "x_m": [0.0, 0.004]},
            {"kind": "box", "x_m": [0.008, 0.012]},
            {"kind": "box", "y_m": [0.0, 0.003]},
            {"kind": "box", "y_m": [0.033, 0.036]},
        ],
        "void": [CHAMBER],
        "volume_fraction": 0.8,
        "void_stiffness": 1e-4,
        "filter_radius_m": 0.0015,
        "air": {"threshold": 0.05, "sharpness": 20.0, "depth_m": 0.0008},
        "schedule": {
            "iterations": 16,
            "ramp": 8,
            "pressure_pa": [1e3, 3e3],
            "penalty": [1.0, 3.0],
            "sharpness": [4.0, 16.0],
        },
    }
    return task_from_dict(data | changes)


def test_layers_in_a_row_stretch_like_springs_in_a_row():
    """A bar of two layers, drawn by a force: F L / (E A) of each."""
    mesh = block("hex8", "solid", (2, 2, 8), (1e-3, 1e-3, 8e-3))
    x, y, z = mesh.points.T
    is_stiff = mesh.points[mesh.cells][:, :, 2].mean(axis=1) > 4e-3
    # Without contraction across, which would restrain the layers where they meet.
    law, force_n = (
        material_from_dict(load_material("dragonskin_10").model_dump() | {"poisson_ratio": 0.0}, ""),
        1e-6,
    )
    top = mesh.faces_at(z == 8e-3)
    loads = no_loads(mesh).hold(x == 0.0, 0).hold(y == 0.0, 1).hold(z == 0.0, 2)
    loads = loads.press(top, -force_n / 1e-6, is_patch=True)
    part = make_part(mesh, law, loads, stiffer=np.where(is_stiff, 7.0, 1.0))
    done = solve(part)
    expected = force_n / (2.0 * law.shear_modulus_pa * 1e-6) * (4e-3 + 4e-3 / 7.0)
    assert done.last.u[z == 8e-3, 2] == pytest.approx(expected, rel=1e-4)
    # The stress is the same in both.
    assert strained(part, done.last.u).stress[:, 2, 2] == pytest.approx(force_n / 1e-6, rel=1e-4)
    with fails(ModelError, "stiffer", "above 0"):
        make_part(mesh, law, loads, stiffer=np.zeros(len(mesh.cells)))


@pytest.mark.slow
def test_a_bar_that_is_its_own_image_moves_by_where_the_stiffer_material_lies(tmp_path):
    """Farther than with a layer of more of it along either side."""
    task = bender()
    domain = make_domain(task)
    state = optimise(task)
    part = shape(domain, state)
    centre = part.mesh.points[part.mesh.cells].mean(axis=1)[:, 0]
    layers = [replace(part, is_stiff=is_there) for is_there in (centre < 0.002, centre > SIZE_M[0] - 0.002)]
    moved, *by_layer = (reanalyse(domain, one) for one in (part, *layers))
    farthest = max(one.motion_m for one in by_layer)
    print(f"{1e3 * moved.motion_m:.3f} mm, with a layer {1e3 * farthest:.3f} mm")
    assert min(one.stiff_m3 for one in layers) > part.stiff_m3
    assert moved.motion_m > 1.2 * farthest > 0.0
    assert part.stiff_m3 == pytest.approx(0.15 * SIZE_M[0] * SIZE_M[1], rel=0.1)
    assert 0.14 < state.rows[-1].stiff <= 0.1501  # at most the limit
    assert moved.motion_m == pytest.approx(state.rows[-1].motion_m, rel=0.05)
    # The same part of the first material alone stays straight.
    alone = reanalyse(domain, replace(part, is_stiff=None))
    assert abs(alone.motion_m) < 1e-9
    save(state, tmp_path)
    again = load_state(tmp_path, domain)
    assert (again.stiff == state.stiff).all()
    assert (stiff_cells(domain, again.stiff, part.mesh) == part.is_stiff).all()
    write_task(task, tmp_path / "task.yaml")
    stl = tmp_path / "bar.stl"
    done = CliRunner().invoke(
        application(), ["design", "export", str(tmp_path), "--stl", str(stl), "--extrude", "10mm"]
    )
    assert done.exit_code == 0, done.output
    soft, stiff = (volume(*read_stl(path)) for path in (stl, tmp_path / "bar_stiff.stl"))
    assert soft + stiff == pytest.approx(0.01 * part.volume_m3, rel=1e-5)
    assert stiff == pytest.approx(0.01 * part.stiff_m3, rel=1e-5)


@pytest.mark.parametrize(
    "shared", [{"quarter_turns": True}, {"repeat": {"along": "x", "pitch_m": 0.004, "number": 3}}]
)
def test_cells_and_quarters_share_the_second_material_in_given_solid_too(shared):
    corner = {"kind": "box", "x_m": [0.0, 0.001], "y_m": [0.0, 0.001]}
    chamber = {"kind": "box", "x_m": [0.004, 0.008], "y_m": [0.004, 0.008]}
    square = {"size_m": [0.012, 0.012], "cells": [12, 12], "solid": [corner]}
    data = bender().model_dump(exclude_none=True, exclude_unset=True)
    data["goal"]["output"] = {"kind": "box", "y_m": [0.012, 0.012]}
    domain = make_domain(task_from_dict(data | square | {"inlet": chamber, "void": [chamber]} | shared))
    n = len(domain.is_solid)
    assert domain.is_solid.any()
    x = np.zeros(2 * n)
    x[n:][domain.is_solid] = 1.0
    found = filters(domain) @ x
    assert (found[:n] == 0.0).all()
    rows = found[n:].reshape(12, 12)
    again = np.rot90(rows) if "quarter_turns" in shared else np.roll(rows, 4, axis=0)
    # At the border of the grid the filter has fewer neighbours.
    inner = slice(None) if "quarter_turns" in shared else slice(5, 8)
    assert rows[inner].max() > 0.01
    np.testing.assert_allclose(again[inner], rows[inner], atol=1e-15)


def test_a_run_without_enough_of_the_second_material_exports_one_file(tmp_path):
    """As after the first iterations, whose shares are below a half everywhere."""
    task = bender()
    save(optimise(task, until=1), tmp_path)
    write_task(task, tmp_path / "task.yaml")
    command = ["design", "export", str(tmp_path), "--stl", str(tmp_path / "a.stl"), "--extrude", "10mm"]
    assert CliRunner().invoke(application(), command).exit_code == 0
    assert [path.name for path in tmp_path.glob("*.stl")] == ["a.stl"]


def test_a_second_material_that_means_nothing_is_refused():
    with refused("goal.stiff.times"):
        bellow(goal={"stiff": {"times": 1.0, "volume_fraction": 0.1}})
    with refused("", names=("lid_mm", "goal.stiff")):
        bellow(goal={"stiff": {"times": 5.0, "volume_fraction": 0.1}}, lid_mm=2.0)

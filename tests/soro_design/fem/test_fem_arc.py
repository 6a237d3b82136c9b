"""Loads beyond a limit point: a balloon and a shallow arch by arc length, against closed forms."""

import numpy as np
import pytest

from soro_core.errors import ModelError
from soro_design.fem.loads import no_loads
from soro_design.fem.meshes.blocks import block
from soro_design.fem.part import make_part
from soro_design.fem.solve.arc import follow
from soro_design.fem.solve.newton import solve
from tests.refused import fails
from tests.soro_design.fem.moving_parts import RISE, RUBBER, balloon, inflated, pressure_of, shallow, snapped


@pytest.mark.slow
def test_a_balloon_is_followed_past_its_greatest_pressure(figure):
    stretch, load = inflated()
    off = load / pressure_of(stretch) - 1.0
    figure(
        f"balloon: {len(load)} steps, pressure off by {np.abs(off).max():.1e}; at most {load.max():.4f} mu"
    )
    assert np.abs(off).max() < 5e-3
    # Past the limit, and well down.
    fine = pressure_of(np.linspace(1.0, 3.0, 2001))
    assert load.max() == pytest.approx(fine.max(), rel=5e-3)
    assert load[-1] < 0.75 * load.max()
    assert (np.diff(stretch) > 0).all()


def test_load_control_names_the_limit_point_and_keeps_the_last_state():
    part, _ = balloon(1.0)
    limit = pressure_of(np.linspace(1.0, 3.0, 2001)).max()
    done = solve(part, (0.1, 1.0))
    assert done.status == "stopped"
    assert "limit point" in done.cause
    assert "follow" in done.cause
    assert [state.load for state in done.states] == [0.1]
    named = float(done.cause.split("limit point at load factor ")[1].split(",")[0])
    assert named == pytest.approx(limit, rel=5e-3)
    assert done.last.load == pytest.approx(named, rel=1e-2)
    assert done.last.load <= named


def test_a_cause_that_is_no_limit_point_is_not_called_one():
    mesh = block("quad4", "plane_strain", (1, 1), (1.0, 1.0))
    loads = no_loads(mesh).hold(mesh.points[:, 0] >= 0.0, 0).hold(mesh.points[:, 1] == 0.0, 1)
    done = solve(make_part(mesh, RUBBER, loads.hold(mesh.points[:, 1] == 1.0, 1, -1.2)))
    assert "limit point" not in done.cause


def test_a_shallow_arch_snaps_through(figure):
    part, done, rise, load, peak = snapped()
    assert done.last.load == 1.0
    off = np.abs(load - shallow(rise)).max() / peak
    figure(
        f"shallow arch: {len(load)} steps, off by {off:.1e} of the limit load {peak:.4g} Pa;"
        f" limits {load[: np.argmin(rise > 0)].max() / peak:.4f} and {load.min() / peak:.4f} of it"
    )
    assert off < 5e-3
    # Up, down below 0, and up again on the other side.
    turns = np.flatnonzero(np.diff(np.sign(np.diff(load))))
    assert len(turns) == 2
    assert load[turns[1] + 1] < 0.0
    assert rise[-1] < -RISE
    # Load control jumps across; beyond, it finds the same state.
    jumped = solve(part)
    assert jumped.status == "solved"
    np.testing.assert_allclose(jumped.last.u, done.last.u, atol=1e-8 * RISE)


def test_what_is_refused():
    part, _ = balloon(1.0)
    for arguments in ({"load": 0.0}, {"load": float("nan")}, {"most_steps": 0}):
        with fails(ModelError, key="load"):
            follow(part, **arguments)


def test_a_part_without_loads_has_no_path():
    mesh = block("quad4", "plane_strain", (1, 1), (1.0, 1.0))
    loads = no_loads(mesh).hold(mesh.points[:, 1] == 0.0, 0).hold(mesh.points[:, 1] == 0.0, 1)
    done = follow(make_part(mesh, RUBBER, loads))
    assert (done.status, done.steps) == ("stopped", 0)
    assert "no load" in done.cause


def test_a_path_that_is_too_long_stops_with_a_cause():
    part, _ = balloon(1.0)
    done = follow(part, most_steps=3)
    assert (done.status, done.steps, len(done.states)) == ("stopped", 3, 3)
    assert "3 steps" in done.cause


def test_prescribed_displacements_are_followed_too():
    """A block that is pulled has no limit: the path is that of load control."""
    mesh = block("quad4", "plane_strain", (2, 2), (1.0, 1.0))
    loads = no_loads(mesh).hold(mesh.points[:, 1] == 0.0, 1).hold(mesh.points[:, 0] == 0.0, 0)
    part = make_part(mesh, RUBBER, loads.hold(mesh.points[:, 1] == 1.0, 1, 0.5))
    found, expected = follow(part).last, solve(part).last
    np.testing.assert_allclose(found.u, expected.u, atol=1e-8)
    np.testing.assert_allclose(found.reaction, expected.reaction, atol=1e-7)

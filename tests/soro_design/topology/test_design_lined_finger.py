"""A finger with a lined channel in space, to the end of its run: sealed, watertight, moving as computed."""

from pathlib import Path

import pytest

from soro_design.topology import load_task, make_domain, optimise, reanalyse, shape
from soro_design.topology.section import final_surface
from soro_design.topology.widths import PRINTABLE_M, least_widths

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1200)]


@pytest.fixture(scope="module")
def finger():
    """Its task on the grid, its last state and its part."""
    task = load_task(Path(__file__).with_name("lined_finger.yaml"))
    domain, state = make_domain(task), optimise(task)
    return domain, state, shape(domain, state)


def test_the_lined_finger_is_sealed_printable_and_watertight(finger):
    domain, state, part = finger
    task, last, ramped = domain.task, state.rows[-1], state.rows[domain.task.schedule.ramp]
    assert last.objective < 1.2 * ramped.objective < 0.0
    assert last.volume < 1.01 * task.volume_fraction
    assert last.greyness < 0.08
    assert not part.leak
    assert least_widths(domain, part.mesh).solid_m >= PRINTABLE_M
    assert part.volume_m3 == pytest.approx(last.volume * domain.grid.volumes.sum(), rel=0.01)
    witness = pytest.importorskip("trimesh").Trimesh(*final_surface(task, part.mesh, 0.0, 0))
    assert witness.is_watertight
    assert witness.volume == pytest.approx(2.0 * part.volume_m3, rel=1e-9)
    assert witness.body_count == 1


def test_the_lined_finger_moves_on_its_own_mesh_as_on_the_grid(finger):
    """With a solver that takes its 33,657 displacements in a minute."""
    pytest.importorskip("pypardiso")
    domain, state, part = finger
    moved = reanalyse(domain, part)
    assert moved.cause == ""
    assert moved.motion_m == pytest.approx(state.rows[-1].motion_m, rel=0.05)

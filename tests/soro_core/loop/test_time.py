"""The time of the loop in one process is that of the plant."""

import numpy as np
import pytest

from soro_core import Loop, load_robot
from soro_core.control import Controller, ControllerConfig
from soro_core.estimation import Estimator
from soro_core.twin import Twin
from soro_lab.scene import load_scene
from soro_lab.scene.loop import loop_of


def test_estimator_and_twin_have_the_same_time():
    """A tick later, and the samples count as a tick older: the estimate is ahead of the arm."""
    scene = load_scene("track_circle", {"platform": "", "mode": "lockstep"})
    twin, loop, before = Twin(scene.loaded_robot, scene.twin_node()), loop_of(scene), []
    ticks = list(
        loop.run(
            twin,
            4,
            twin.dt,
            reference=lambda t, state: before.append(state.estimator.t_s),
            before_s=-twin.dt,
        )
    )
    assert before == pytest.approx([tick.t_s - twin.dt for tick in ticks])
    # A pose counts from the same zero.
    assert ticks[1].seen.poses[0].stamp_s == pytest.approx(ticks[0].t_s)


def test_a_loop_tells_how_many_set_points_lie_at_a_bound(caplog):
    """As the verdict of a run does; 90 kPa hold a curvature of 6 1/m, not of 30."""
    robot = load_robot("tue_three_bellow")
    for curvature, is_at_bound in ((6.0, False), (30.0, True)):
        caplog.clear()
        circle = ControllerConfig(reference={"kind": "circle", "curvature_per_m": curvature})
        loop, twin = Loop(Estimator(robot), Controller(robot, circle)), Twin(robot)
        ticks = list(loop.run(twin, 500, twin.dt, before_s=-twin.dt))
        part = np.mean([tick.command.saturated for tick in ticks])
        assert (ticks[-1].at_bound_part, part > 0.2) == (pytest.approx(part), is_at_bound)
        assert f"{part:.0%} of them at a bound" in repr(ticks[-1])
        assert any("set points at a bound" in line for line in caplog.messages) == is_at_bound

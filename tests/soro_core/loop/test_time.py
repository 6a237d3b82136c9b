"""The time of the loop in one process is that of the plant."""

import pytest

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

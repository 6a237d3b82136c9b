"""References on the topics of a real controller, sent again and again, as a stream, and refused."""

import numpy as np
import pytest

from soro_ros.conversion import messages
from tests.soro_ros.test_nodes import COORDINATES, Person, person, tip_pose, trajectory

pytestmark = pytest.mark.process

TICKS_HZ = 200


def stream(it: Person, publisher, message_at, hz: int, seconds: float) -> float:
    """Publish `message_at(t)` at a rate of the ticks' time; returns when it began."""
    it.seen.clear()
    started = it.t_s
    for tick in range(round(seconds * TICKS_HZ)):
        if tick % (TICKS_HZ // hz) == 0:
            publisher.publish(message_at(tick / TICKS_HZ))
        it.tick()
    return started


def rest(it: Person) -> None:
    """Go on until nothing has moved for a while."""
    it.hold(lambda: len(it.seen) > 50 and np.ptp([w for _, w in it.seen[-40:]], axis=0).max() < 1e-7)


def at(t: float) -> np.ndarray:
    """A circle of 12 mm in 6 s."""
    angle = 2 * np.pi * t / 6.0
    return tip_pose(0.012 * np.cos(angle), 0.012 * np.sin(angle), 0.066)


def test_references_may_be_sent_at_any_rate(domain, figure):
    with person(start_s=0.3) as it:
        it.supervisor.call("controller/enable")
        it.hold(lambda: len(it.commands) > 5)

        # One pose, and one point, again and again.
        pose = tip_pose(0.01, 0.0, 0.066)
        for publisher, message_at, goal in (
            (it.tip, lambda t: messages.pose_stamped(pose, round(t * 1e9), "world"), pose[:3, 3]),
            (
                it.trajectory,
                lambda t: trajectory(COORDINATES, [([0.05, 0, 0], 1.0)]),
                np.array([0.0, 0.0, 0.064 * 1.05]),
            ),
        ):
            for hz in (5, 100):
                stream(it, publisher, message_at, hz, 1.2)
                assert it.wanted == pytest.approx(goal, abs=1e-6)
                steps = np.linalg.norm(np.diff([w for _, w in it.seen], axis=0), axis=1)
                assert steps.max() < 5e-3

        # A circle, that is not finished.
        started = stream(it, it.tip, lambda t: messages.pose_stamped(at(t), 0, ""), 50, 2.5)
        path = [(stamp - started, w) for stamp, w in it.seen if stamp > started + 1.2]
        lags = np.arange(0.0, 0.4, 0.005)
        errors = [np.mean([np.linalg.norm(w - at(t - x)[:3, 3]) for t, w in path]) for x in lags]
        lag = lags[np.argmin(errors)]
        figure(f"circle on a topic at 50 Hz: {1e3 * lag:.0f} ms late, {1e3 * min(errors):.2f} mm off")
        assert 0.08 < lag < 0.25
        assert min(errors) < 0.5e-3
        rest(it)
        assert it.wanted == pytest.approx(at(2.5)[:3, 3], abs=0.6e-3)

        # What is refused, in one line, changes nothing.
        before = it.wanted
        for wrong, frame, names in (
            (tip_pose(0.0, 0.0, 0.066), "camera", ("header.frame_id", "camera")),
            (tip_pose(np.nan, 0.0, 0.066), "", ("nan",)),
            (tip_pose(0.5, 0.0, 0.5), "", ("0.5",)),
        ):
            stream(it, it.tip, lambda t, p=wrong, f=frame: messages.pose_stamped(p, 0, f), 20, 0.4)
            it.hold(lambda names=names: all(name in it.said for name in names))
            assert "\n" not in it.said
            assert it.wanted == pytest.approx(before, abs=1e-6)

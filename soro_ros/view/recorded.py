"""A recorded run in the view: its moments, and their playback."""

from __future__ import annotations

import time
from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import viser
from sensor_msgs.msg import JointState

from soro_core.arrays import Array
from soro_core.errors import BagError
from soro_core.robot import Discretisation, Robot
from soro_lab.bag import BagMessage, BagReader
from soro_ros.conversion.decoding import Messages
from soro_ros.recordings.bodies.tracks import BodyTrack
from soro_ros.view.drawn_bodies import DrawnBodies
from soro_ros.view.moment import BACKBONE, DIAGNOSTICS, PRESSURES, STALE_S, TOPICS, Moment, Received
from soro_ros.view.page import ViewerPage, set_value

Shape = Callable[[Array], Array]

_STATE = "arm/state"
_FASTEST_HZ = 20.0


def namespace_of(reader: BagReader, wanted: str) -> str:
    """Return the namespace of the arm of a bag, ``/track_circle``.

    Raises
    ------
    BagError
        If no arm, or more than one, is recorded and `wanted` names none of them.
    """
    reader.check_encodings()
    found = sorted(
        topic.name.removesuffix(f"/{PRESSURES}")
        for topic in reader.topics
        if topic.name.endswith(f"/{PRESSURES}")
    )
    if wanted and f"/{wanted.strip('/')}" in found:
        return f"/{wanted.strip('/')}"
    if len(found) == 1 and not wanted:
        return found[0]
    known = ", ".join(found) or f"none, there is no {PRESSURES}"
    raise BagError(f"which arm? --namespace {wanted or 'NAME'}; recorded: {known}", reader.path, "missing")


def moments(
    reader: BagReader,
    namespace: str,
    shape: Shape | None,
    rate_hz: float,
    say: Callable[[str], None] = lambda line: None,
) -> list[Moment]:
    """Return the moments of a recorded run at a rate of the recorded time.

    Parameters
    ----------
    reader : BagReader
    namespace : str
        Of the arm's nodes.
    shape : callable or None
        Gives the backbone (n, 4, 4) of recorded coordinates (n_q,); None: arm/backbone is drawn.
    rate_hz : float
    say : callable
        Takes a line on what is damaged, or cannot be read and is left out.

    Raises
    ------
    BagError
        If there are no pressures, whose stamps are the time of the run.
    """
    # Lockstep runs at any speed: how long a node was silent says nothing.
    received = Received(namespace, silent_s=np.inf)
    kinds = {f"{namespace}/{name}" if name[0] != "/" else name: name for name in TOPICS}
    if shape is not None:
        del kinds[f"{namespace}/{BACKBONE}"]
        kinds[f"{namespace}/{_STATE}"] = _STATE

    recorded = Messages(reader, {topic: TOPICS.get(name, JointState) for topic, name in kinds.items()})
    recorded.need([f"{namespace}/{PRESSURES}"])
    found: list[Moment] = []
    newest: dict[str, BagMessage] = {}
    due_s, state, state_s = 0.0, None, -np.inf
    for item in reader.messages({topic.name for topic in reader.topics} & kinds.keys()):
        name = kinds[item.topic]
        if name not in (PRESSURES, DIAGNOSTICS):
            newest[name] = item  # only the last before a moment is read
            continue
        if (message := recorded.read(item)) is None:
            continue
        received.take(name, message, received.t_s)
        if name == DIAGNOSTICS or received.t_s < due_s:
            continue
        due_s = received.t_s + 1.0 / rate_hz - 1e-6
        for other, last in newest.items():
            if (message := recorded.read(last)) is None:
                continue
            if other == _STATE:
                state, state_s = np.array(message.position), received.t_s
            else:
                received.take(other, message, received.t_s)
        newest.clear()
        moment = received.moment(received.t_s)
        if shape is not None and state is not None and state.size and received.t_s - state_s <= STALE_S:
            moment = replace(moment, backbone=shape(state))
        found.append(moment)
    for problem in recorded.problems:
        say(problem)
    if not found:
        raise BagError(f"no message on {namespace}/{PRESSURES}", reader.path, "missing")
    return found


class RecordedPage:
    """The page of a recorded run: play, pause and a slider over its time.

    Parameters
    ----------
    server : viser.ViserServer
    arms : mapping of str to tuple
        Robot and moments of each arm by its name; that of a single one may be empty. The first sets the time.
    trail_s : float
        Length of trails and plots [s].
    bodies : mapping of str to BodyTrack, optional
        What the arms touch, by name.
    mounts : mapping of str to str
        Arms at the tip of another one, and which, by name.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        arms: Mapping[str, tuple[Robot, Sequence[Moment]]],
        trail_s: float,
        bodies: Mapping[str, BodyTrack] | None = None,
        mounts: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        self._tracks = bodies or {}
        self._bodies = DrawnBodies(server, {name: track.body for name, track in self._tracks.items()})
        self._server, self._trail_s = server, trail_s
        self._recorded = [moments for _, moments in arms.values()]
        self._times = [moment.t_s for moment in self._recorded[0]]
        end_s = max(self._times[-1], 1e-3)
        self._button = server.gui.add_button("pause")
        self._slider = server.gui.add_slider("time [s]", 0.0, end_s, step=end_s / 1000, initial_value=0.0)
        self._speed = server.gui.add_dropdown("speed", ("0.25", "0.5", "1", "2", "5"), initial_value="1")
        self._pages = [
            ViewerPage(server, robot, name=name, carrier=mounts.get(name, ""))
            for name, (robot, _) in arms.items()
        ]
        self._t_s, self._playing, self._moved = 0.0, True, True
        self._button.on_click(lambda _: self._toggle())
        self._slider.on_update(self._on_slider)

    def run(self, ended: Callable[[], bool]) -> None:
        """Play until a function says that it has ended."""
        before_s = time.monotonic()
        while not ended():
            now_s = time.monotonic()
            self.step(now_s - before_s)
            before_s = now_s
            time.sleep(1.0 / _FASTEST_HZ)

    def step(self, passed_s: float) -> None:
        """Go on by a time [s], at the speed that is set, and draw; stand still while no page is open."""
        if not self._server.get_clients():
            return
        if self._playing:
            self._t_s += passed_s * float(self._speed.value)
            if self._t_s >= self._times[-1]:
                self._t_s, self._playing, self._moved = self._times[-1], False, True
                self._button.label = "play"
            set_value(self._slider, self._t_s)
        if self._playing or self._moved:
            at_once, self._moved = self._moved, False
            for page, recorded in zip(self._pages, self._recorded, strict=True):
                page.show(self.shown(recorded), at_once)
            self._bodies.show({name: track.at(self._t_s) for name, track in self._tracks.items()})

    def shown(self, recorded: Sequence[Moment]) -> Sequence[Moment]:
        """Return the moments of an arm's trail, the last of which is the present one."""
        last = min(bisect_left(recorded, self._t_s, key=_time), len(recorded) - 1)
        first = bisect_left(recorded, recorded[last].t_s - self._trail_s, key=_time)
        return recorded[first : last + 1]

    def seek(self, t_s: float) -> None:
        """Go to a time of the run [s]."""
        self._t_s, self._moved = t_s, True

    def _toggle(self) -> None:
        if not self._playing and self._t_s >= self._times[-1]:
            self.seek(0.0)
        self._playing = not self._playing
        self._button.label = "pause" if self._playing else "play"

    def _on_slider(self, event: viser.GuiEvent[viser.GuiSliderHandle[float]]) -> None:
        if event.client is not None:  # moved in the browser, not by `step`
            self.seek(self._slider.value)


def _time(moment: Moment) -> float:
    return moment.t_s


def shape_of(robot: Robot, discretisation: Discretisation) -> Shape:
    """Return the function from coordinates to the backbone of a robot, as the estimator sees it."""
    from soro_core.model.discretised import discretised

    arm = discretised(robot, discretisation)
    places = np.linspace(0.0, arm.length, 21)
    return lambda q: np.array([arm.pose(q, s) for s in places])


def read(
    bag: Path,
    namespace: str,
    shape: Shape | None,
    rate_hz: float,
    say: Callable[[str], None] = lambda line: None,
) -> list[Moment]:
    """Read a bag, with an empty namespace that of its only arm; other parameters as in `moments`."""
    with BagReader(bag) as reader:
        return moments(reader, namespace_of(reader, namespace), shape, rate_hz, say)

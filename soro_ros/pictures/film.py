"""A film of a recorded run: the arm on its reference, the pressures in its chambers, the error of its tip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from soro_core.arrays import Array
from soro_core.config import with_changes
from soro_core.errors import BagError
from soro_core.model.discretised import discretised
from soro_core.robot import Plane, Robot
from soro_core.robot.basis import radius_profile
from soro_core.twin.config import described_plant
from soro_core.twin.plant import true_robot
from soro_lab.scene import Scene
from soro_ros.recordings.bodies.tracks import BodyTrack
from soro_ros.recordings.recording import RunRecording
from soro_ros.recordings.report import in_control, pressure_bounds, read_run, tip_error
from soro_ros.view.arm_shape import COLOURS, Camera, Faces, chambers, lit_faces, places, surface, walls
from soro_ros.view.body_shape import colour_of, faces_of, grounds_of

if TYPE_CHECKING:
    from matplotlib.collections import PolyCollection


TRACE_S = 4.0
_SIZE_IN = (8.0, 4.5)
_TEXT, _PALE, _RED = "#333333", "#b9bec6", "#c1121f"


@dataclass(frozen=True)
class Take:
    """Everything that the pictures of a run are drawn from, at the times `t` (n,) [s] of the pictures.

    Poses (n, m, 4, 4) of the backbone at the arc lengths `s` (m,); pressures, set points (n, chambers) [Pa].
    """

    scene: Scene
    robot: Robot
    recording: RunRecording
    t: Array
    s: Array
    poses: Array
    pressure: Array
    command: Array
    most_pa: float
    bodies: Sequence[BodyTrack] = ()
    carried: Sequence[Take] = ()
    """Arms at its tip, at the same times, their poses in the world too."""

    def until(self, n: int, carried: Sequence[Take] = ()) -> Take:
        """Return the first n pictures, with arms at its tip."""
        rows = {key: getattr(self, key)[:n] for key in ("t", "poses", "pressure", "command")}
        return replace(self, carried=carried, **rows)

    def on_tip(self, carrier: Take, n: int) -> Take:
        """Return the first n pictures of an arm that was seen from the tip of its carrier, in the world."""
        return replace(self.until(n), poses=carrier.poses[:n, -1:] @ self.poses[:n])

    def payload_kg(self, k: int) -> float:
        """Payload [kg] of a simulated arm at picture `k`; 0 for a real one, whose payload is not known."""
        return self.scene.twin.payload_at(float(self.t[k])) if self.scene.arm == "simulated" else 0.0

    def faces(self, k: int) -> Faces:
        """Surface of the arm in picture `k`."""
        part = np.clip(self.pressure[k] / self.most_pa, 0.0, 1.0)
        pressure = dict(zip(self.recording.reading.names, part, strict=True))
        return surface(self.robot, self.s, self.poses[k], pressure, self.payload_kg(k))


def take(
    bag: Path,
    scene: Scene,
    begin_s: float,
    end_s: float,
    rate_hz: float,
    bodies: Sequence[BodyTrack] = (),
) -> Take:
    """Read a run and compute the shape of its arm at each picture.

    A simulated arm is drawn as the twin's plant had it, a real one as the estimator found it.

    Parameters
    ----------
    bag : Path
        Folder of the run's bag.
    scene : Scene
    begin_s, end_s : float
        First and last time [s] of the run; the film ends at the latest where the recording does.
    rate_hz : float
        Pictures a second.
    bodies : sequence of BodyTrack
        What the arms of the scene touch.

    Raises
    ------
    BagError
        If the bag has no coordinates or no pressures of that time.
    """
    recording = read_run(bag, scene)
    robot = scene.loaded_robot
    if recording.true_state.t.size:
        states, twin = recording.true_state, scene.twin_node()
        true = true_robot(robot, twin)  # of a file of its own, at the place of the arm
        arm = discretised(true.replace(**scene.place) if scene.place else true, twin.model)
    else:
        states, arm = recording.estimated_state, discretised(robot, scene.discretisation)
    known = (states, recording.reading, recording.command)
    if any(series.t.size < 2 for series in known):
        raise BagError(f"no states or no pressures of the arm {scene.name}", bag, "missing")
    end_s = min(end_s, *(float(series.t[-1]) for series in known))
    if end_s < begin_s + 1.0 / rate_hz:
        raise BagError(f"ends at {end_s:.2f} s, too early for a film from {begin_s:g} s on", bag, "value")
    t = np.arange(begin_s, end_s + 1e-9, 1.0 / rate_hz)
    s = places(robot)
    poses = np.array([[arm.pose(q, min(at, arm.length)) for at in s] for q in states.at(t)])
    pressure, command = recording.reading.at(t), recording.command.at(t)
    if recording.wanted_tip.t.size:  # what the law says behind a trip reaches no valve
        command[~in_control(recording, t, scene.duration_s)] = np.nan
    most = max(pressure_bounds(scene)[1], float(np.nanmax(pressure, initial=0.0)))
    return Take(scene, robot, recording, t, s, poses, pressure, command, most, bodies)


def with_carried(shown: Take, bag: Path, carried: Sequence[Scene], rate_hz: float) -> Take:
    """Return a take with the arms at the tip of its own.

    Parameters
    ----------
    shown : Take
    bag, rate_hz : Path, float
        As of `take`.
    carried : sequence of Scene
        Those arms.
    """
    others = [take(bag, one, float(shown.t[0]), float(shown.t[-1]), rate_hz) for one in carried]
    n = min(len(one.t) for one in (shown, *others))
    return shown.until(n, [one.on_tip(shown, n) for one in others])


class AnimatedFigure:
    """One figure that shows one time of a take after the other."""

    def __init__(self, shown: Take, width_px: int = 800) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self._take, self._camera = shown, Camera()
        self._figure = Figure(figsize=_SIZE_IN, dpi=width_px / _SIZE_IN[0], facecolor="white")
        self._canvas = FigureCanvasAgg(self._figure)
        self._make_arm(self._figure.add_axes((0.0, 0.08, 0.62, 0.86)))
        self._make_bars(self._figure.add_axes((0.66, 0.56, 0.31, 0.36)))
        self._make_error(self._figure.add_axes((0.66, 0.13, 0.31, 0.28)))

    def at(self, k: int) -> NDArray[np.uint8]:
        """Pixels (height, width, 3) of picture `k` of the take."""
        self._draw_arm(k)
        self._draw_bars(k)
        now = self._take.t[k]
        past = self._error_t <= now
        self._error_line.set_data(self._error_t[past], self._error[past])
        self._error_dot.set_data(self._error_t[past][-1:], self._error[past][-1:])
        self._canvas.draw()
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()

    def _make_arm(self, axis: Any) -> None:
        from matplotlib.collections import PolyCollection
        from matplotlib.lines import Line2D

        shown, radius = self._take, self._take.robot.links[0].radius
        path = shown.recording.wanted_tip
        inside = (path.t >= 0.0) & (path.t <= shown.scene.duration_s)
        self._wanted = path.value[inside]
        self._planes: tuple[Plane, ...] = ()
        if shown.scene.arm == "simulated":
            contacts = described_plant(shown.robot, shown.scene.twin_node()).contacts
            self._planes = contacts.planes if contacts else ()
        self._bodies = [(one, faces_of(one.body), colour_of(one.body)) for one in shown.bodies]
        self._planes = (*self._planes, *grounds_of(one.body for one in shown.bodies))
        near = [
            faces.reshape(-1, 3) + track.at(t)[:3, 3]
            for track, faces, _ in self._bodies
            for t in (shown.t[0], shown.t[-1])
        ]
        arms = [one.poses[..., :3, 3].reshape(-1, 3) for one in (shown, *shown.carried)]
        body = np.concatenate([*arms, *near])
        self._floor = float(body[:, 2].min()) - 0.02 * radius
        seen = self._camera.project(np.concatenate([body, self._fallen(body), self._wanted]))
        self._body = body
        self._walls = PolyCollection([], facecolors="#e8dcc4", edgecolors="#a08c63")
        axis.add_collection(self._walls)
        low, high = seen[:, :2].min(axis=0) - 1.1 * radius, seen[:, :2].max(axis=0) + 2.2 * radius
        axis.set_aspect("equal")
        axis.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        axis.axis("off")
        self._title = self._figure.text(0.03, 0.93, "", color=_TEXT, size=11, weight="bold")
        self._time = self._figure.text(0.03, 0.87, "", color=_TEXT, size=10)
        for x, colour, text in ((0.03, _PALE, "reference of the tip"), (0.27, _RED, "path of the tip")):
            self._figure.add_artist(Line2D((x, x + 0.03), (0.05, 0.05), color=colour, lw=2.5))
            self._figure.text(x + 0.04, 0.05, text, va="center", color=_TEXT, size=9)
        self._shadow = PolyCollection([], facecolors="#e4e7ec", edgecolors="#e4e7ec", linewidths=0.3)
        self._faces = PolyCollection([], linewidths=0.25)
        axis.add_collection(self._shadow)
        axis.add_collection(self._faces)

    def _draw_arm(self, k: int) -> None:
        shown = self._take
        planes, wall = self._planes, shown.scene.twin.wall
        if shown.scene.arm == "simulated" and wall.stiffness:
            planes = (*planes, with_changes(wall.plane, point=tuple(wall.at(shown.t[k])[0])))
        self._walls.set_verts([self._camera.project(one)[:, :2] for one in walls(planes, self._body)])
        payload_kg = shown.payload_kg(k)
        own = [one.faces(k) for one in (shown, *shown.carried)]
        solid = [(np.concatenate([one.corners for one in own]), np.concatenate([one.colours for one in own]))]
        for track, corners, colour in self._bodies:
            pose = track.at(float(shown.t[k]))
            lit = lit_faces(corners @ pose[:3, :3].T + pose[:3, 3], colour)
            solid.append((lit.corners, lit.colours))
        every = np.concatenate([corners for corners, _ in solid])
        _show_faces(self._shadow, self._camera.project(self._fallen(every)))
        width = 0.045 * shown.robot.links[0].radius
        true = shown.recording.true_tip
        passed = (true.t >= shown.t[k] - TRACE_S) & (true.t <= shown.t[k]) & (true.t >= 0.0)
        path = self._ribbon(true.value[passed], 1.3 * width, _RED, shown.poses[k, -1, :3, 3])
        path[0][..., 2] += 8 * width  # over the reference where the two are together
        arm, *bodies = [(self._camera.project(corners), colours) for corners, colours in solid]
        pieces = [
            arm,
            *_towards_viewer(bodies),
            self._ribbon(self._wanted, 1.6 * width, _PALE, shown.poses[k, -1, :3, 3]),
            path,
        ]
        corners = np.concatenate([corners for corners, _ in pieces])
        order = np.argsort(corners[..., 2].mean(axis=1))
        colours = np.concatenate([colours for _, colours in pieces])[order]
        _show_faces(self._faces, corners[order])
        self._faces.set_facecolor(colours)
        self._faces.set_edgecolor(colours)
        self._time.set_text(f"{shown.t[k]:.1f} s")
        carries = f" carries {payload_kg * 1e3:g} g" if payload_kg else ""
        self._title.set_text(f"{shown.robot.name}{carries}")

    def _fallen(self, points: Array) -> Array:
        """The shadow of points on the floor."""
        shadow = points.copy()
        shadow[..., :2] += (points[..., 2:] - self._floor) * (0.12, 0.06)
        shadow[..., 2] = self._floor
        return shadow

    def _ribbon(self, points: Array, width: float, colour: str, tip: Array) -> tuple[Array, Array]:
        """A line in space as faces of a width on the screen, so that the arm hides what is behind it.

        What ends within the plate at the tip goes behind it.
        """
        from matplotlib.colors import to_rgb

        if len(points) < 3:
            return np.zeros((0, 4, 3)), np.zeros((0, 3))
        points = points[:: max(1, len(points) // 400)]
        seen = self._camera.project(points)
        radius = radius_profile(self._take.robot.links[-1], np.ones(1))[0]
        seen[np.linalg.norm(points - tip, axis=1) < radius, 2] -= 2 * radius
        along = np.gradient(seen[:, :2], axis=0)
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
        beside = 0.5 * width * np.column_stack([-along[:, 1], along[:, 0], np.zeros(len(seen))])
        left, right = seen + beside, seen - beside
        corners = np.stack([left[:-1], left[1:], right[1:], right[:-1]], axis=1)
        return corners, np.tile(to_rgb(colour), (len(corners), 1))

    def _make_bars(self, axis: Any) -> None:
        names = self._take.recording.reading.names
        where = np.arange(len(names))
        order = [bellow.name for bellow in chambers(self._take.robot)]
        colours = [COLOURS[order.index(name) % len(COLOURS)] if name in order else _TEXT for name in names]
        self._bars = axis.bar(where, np.zeros(len(names)), width=0.62, color=colours)
        (self._ticks,) = axis.plot(
            where, np.zeros(len(names)), "_", color=_TEXT, ms=78 / max(3, len(names)), mew=1.5
        )
        one = all(name.startswith("link0/") for name in names)
        digits = [name.replace("link", "").replace("chamber", "") for name in names]
        axis.set_xticks(where, [name.removeprefix("link0/") for name in names] if one else digits)
        axis.set_xlabel("" if one else "link/chamber", size=9, color=_TEXT)
        self._style(axis, "pressure [kPa]; line: set point")
        least_pa = float(np.nanmin(self._take.pressure, initial=0.0))
        axis.set_ylim(min(0.0, least_pa) / 1e3, self._take.most_pa / 1e3)

    def _draw_bars(self, k: int) -> None:
        for bar, value in zip(self._bars, self._take.pressure[k], strict=True):
            bar.set_height(value / 1e3)
        self._ticks.set_ydata(self._take.command[k] / 1e3)

    def _make_error(self, axis: Any) -> None:
        shown = self._take
        t, error = tip_error(shown.recording, shown.scene.duration_s)
        inside = (t >= shown.t[0]) & (t <= shown.t[-1])
        self._error_t, self._error = t[inside], error[inside] * 1e3
        (self._error_line,) = axis.plot([], [], color=_RED, lw=1.5)
        (self._error_dot,) = axis.plot([], [], "o", color=_RED, ms=5)
        self._style(axis, "tip to reference [mm]")
        axis.set_xlim(shown.t[0], shown.t[-1])
        axis.set_ylim(0, 1.1 * max(float(self._error.max()), 0.1) if self._error.size else 1)
        axis.set_xlabel("time [s]", size=9, color=_TEXT)

    def _style(self, axis: Any, title: str) -> None:
        axis.set_title(title, loc="left", size=9, color=_TEXT)
        axis.spines[["top", "right"]].set_visible(False)
        axis.spines[["left", "bottom"]].set_color(_PALE)
        axis.tick_params(labelsize=8, colors=_TEXT, length=2, color=_PALE)
        axis.grid(axis="y", alpha=0.25)
        axis.set_axisbelow(True)


def _towards_viewer(bodies: list[tuple[Array, Array]]) -> list[tuple[Array, Array]]:
    """Faces, as seen, of closed bodies, and their colours, without those that are turned away."""
    shown = []
    for corners, colours in bodies:
        one, other = corners[:, 2, :2] - corners[:, 0, :2], corners[:, 3, :2] - corners[:, 1, :2]
        towards = one[:, 0] * other[:, 1] > one[:, 1] * other[:, 0]
        shown.append((corners[towards], colours[towards]))
    return shown


def _show_faces(faces: PolyCollection, corners: Array) -> None:
    """Show faces with these corners (n, 4, 3), as the camera sees them."""
    faces.set_verts(corners[..., :2])  # type: ignore[arg-type]  # an array is drawn faster than the sequence of its type


def write(shown: Take, file: Path, width_px: int = 800, colours: int = 96) -> None:
    """Write a take as a film: an animated GIF that begins again at its end.

    Parameters
    ----------
    shown : Take
    file : Path
        Where it is written.
    width_px : int
        Width of the film; its height is 9/16 of that.
    colours : int
        In its palette, 16 to 256: fewer make a smaller file.
    """
    from PIL import Image
    from rich.console import Console
    from rich.progress import track

    picture, console = AnimatedFigure(shown, width_px), Console(stderr=True)
    hidden = not console.is_terminal
    numbers = track(range(len(shown.t)), "drawing", console=console, transient=True, disable=hidden)
    images = [picture.at(k) for k in numbers]
    palette = _palette(images[:: max(1, len(images) // 8)], colours)
    frames = [Image.fromarray(image).quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    each_ms = round(1000 * (shown.t[-1] - shown.t[0]) / max(1, len(shown.t) - 1) / 10) * 10
    frames[0].save(file, save_all=True, append_images=frames[1:], duration=each_ms, loop=0, optimize=False)


def _palette(images: list[NDArray[np.uint8]], colours: int) -> Any:
    """The colours of the figure as they are, and those that occur, large areas counted by their root."""
    from matplotlib.colors import to_rgb
    from PIL import Image

    fixed = np.array([to_rgb(colour) for colour in ("white", _TEXT, _PALE, _RED, *COLOURS)]) * 255
    pixels = np.concatenate([image[::2, ::2].reshape(-1, 3) for image in images])
    seen, count = np.unique(pixels[pixels.min(axis=1) < 245], axis=0, return_counts=True)
    seen = np.repeat(seen, np.ceil(np.sqrt(count)).astype(int), axis=0)
    rest = Image.fromarray(seen[None]).quantize(colours - len(fixed), kmeans=4).getpalette()
    palette = Image.new("P", (1, 1))
    palette.putpalette([*fixed.astype(int).ravel().tolist(), *(rest or [])[: 3 * (colours - len(fixed))]])
    return palette


def still(shown: Take, file: Path, width_px: int = 800) -> None:
    """Write the last picture of a take as PNG.

    Parameters
    ----------
    shown : Take
    file : Path
    width_px : int
        Width of the picture [pixels].
    """
    from PIL import Image

    Image.fromarray(AnimatedFigure(shown, width_px).at(len(shown.t) - 1)).save(file, optimize=True)

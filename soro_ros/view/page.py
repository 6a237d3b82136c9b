"""The page of the view: the arm in space, its pressures, and what is wrong with it."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
import viser
from viser.uplot import Scale, Series

from soro_core.arrays import Array
from soro_core.robot import Robot
from soro_core.rotation import quaternion_from_matrix
from soro_ros.status_words import STAGES
from soro_ros.view.arm_shape import COLOURS, arrow_of, between
from soro_ros.view.moment import Moment
from soro_ros.view.skin import Skin

# A plot is sent as a whole, and its lines are too thin to be read at the rate of the arm.
_PERIOD_S = 0.25


class Plots:
    """Two plots over time.

    Parameters
    ----------
    gui : viser.GuiApi
    chambers : sequence of str
        Names of the chambers.
    most_pa : float
        Highest pressure [Pa gauge].
    """

    def __init__(self, gui: viser.GuiApi, chambers: Sequence[str], most_pa: float) -> None:
        self._chambers, self._shown_s, self._range_kpa = chambers, 0.0, (0.0, most_pa / 1e3)
        colours = [COLOURS[k % len(COLOURS)] for k in range(len(chambers))]
        lines = [Series(label=name, stroke=c, width=2) for name, c in zip(chambers, colours, strict=True)]
        self._pressure = _plot(gui, "pressure [kPa]", lines, Scale(auto=True, range=self._range_kpa))
        error = [Series(label="distance", stroke="#c1121f", width=2)]
        self._error = _plot(gui, "tip to reference [mm]", error, Scale(auto=True))

    def show(self, past: Sequence[Moment], at_once: bool = False) -> None:
        """Draw moments; only now and then, unless `at_once`."""
        now_s = time.monotonic()
        if now_s < self._shown_s + _PERIOD_S and not at_once:
            return
        self._shown_s = now_s
        t = np.array([one.t_s for one in past])
        pressures = [[one.pressure.get(name, np.nan) for one in past] for name in self._chambers]
        kpa = 1e-3 * np.array(pressures)
        low, high = self._range_kpa
        wider = min(low, float(np.nanmin(kpa, initial=low))), max(high, float(np.nanmax(kpa, initial=high)))
        if wider != self._range_kpa:  # a pressure beyond the range of the robot is what one looks for
            self._range_kpa = wider
            self._pressure.scales = {"x": Scale(time=False), "y": Scale(auto=True, range=wider)}
        self._pressure.data = (t, *kpa)
        self._error.data = (t, np.array([one.error_m for one in past]) * 1e3)


def _plot(gui: viser.GuiApi, title: str, lines: Sequence[Series], y: Scale) -> viser.GuiUplotHandle:
    return gui.add_uplot(
        data=tuple(np.zeros(1) for _ in range(len(lines) + 1)),
        series=(Series(label="t [s]"), *lines),
        scales={"x": Scale(time=False), "y": y},
        title=title,
        aspect=1.7,
    )


def touching(robot: Robot, backbone: Array) -> Array:
    """Return the points (k, 3) [m] of the arm that have sunk into an obstacle.

    Parameters
    ----------
    robot : Robot
    backbone : ndarray (n, 4, 4)
        Poses at equal distances from base to tip.
    """
    if robot.contacts is None:
        return np.zeros((0, 3))
    begin, places = 0.0, []
    for link in robot.links:
        parts = np.arange(1, robot.contacts.points_per_link + 1) / robot.contacts.points_per_link
        places.append(begin + parts * link.length)
        begin += link.length
    s = np.linspace(0.0, robot.length, len(backbone))
    x = between(s, backbone, np.concatenate(places))[:, :3, 3]
    gaps = [np.full(len(x), np.inf)]
    for plane in robot.contacts.planes:
        normal = np.asarray(plane.normal) / np.linalg.norm(plane.normal)
        gaps.append((x - plane.point) @ normal)
    for sphere in robot.contacts.spheres:
        gaps.append(np.linalg.norm(x - sphere.centre, axis=1) - sphere.radius)
    return np.asarray(x[np.min(gaps, axis=0) < 0.0])


def turned_to(normal: tuple[float, ...]) -> Array:
    """Return the quaternion (w, x, y, z) that turns the z axis to a direction."""
    n = np.asarray(normal) / np.linalg.norm(normal)
    half = np.array([1.0 + n[2], -n[1], n[0], 0.0])  # 1 + z . n, z x n
    size = np.linalg.norm(half)
    return np.asarray(half / size) if size > 1e-9 else np.array([0.0, 1.0, 0.0, 0.0])


Value = TypeVar("Value")

_REFERENCE, _TIP, _CONTACT, _OBSTACLE = (140, 146, 156), (193, 18, 31), (255, 120, 0), (150, 160, 175)
_NOTHING = np.zeros((1, 2, 3))
# Smaller steps of a vertex are not worth a message [m].
_STEP_M = 2e-5


class ViewerPage:
    """Draws moments into the scene and the panel of a viser server; what has not changed is not sent.

    Parameters
    ----------
    server : viser.ViserServer
    robot : Robot
        Its skin, and its obstacles.
    payload_kg : float
        Payload drawn at the tip; 0 for none.
    name : str
        Of one of several arms: its drawings and its part of the panel have it.
    carrier : str
        Name of the arm at whose tip it is: what it draws moves with that; empty: in the world.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        robot: Robot,
        payload_kg: float = 0.0,
        name: str = "",
        carrier: str = "",
    ) -> None:
        self._name, self._own = name, f"/{name}" if name else ""
        if carrier:
            self._own = f"/{carrier}/tip{self._own}"
        self._server, self._robot, self._skin = server, robot, Skin(robot, payload_kg=payload_kg)
        self._vertices: list[Array] = []
        self._head = ""
        self._most_pa = robot.pressure_range_pa[1]
        length, radius = robot.length, max(link.radius for link in robot.links)
        base = np.array(robot.base_position)
        if not carrier:
            server.initial_camera.position = tuple(base + length * np.array([1.5, -1.2, 1.5]))
            server.initial_camera.look_at = tuple(base + length * np.array([0.15, 0.2, 0.5]))
            self._make_surroundings(length)
        self._make_arm(length, radius)
        gui = server.gui
        with gui.add_folder(name) if name else contextlib.nullcontext():
            self._valves = gui.add_text("valves", "", multiline=True, disabled=True)
            self._state = gui.add_text("arm", "", disabled=True)
            self._faults = gui.add_text("faults", "", multiline=True, disabled=True)
            self.plots = Plots(gui, robot.chamber_names, self._most_pa)

    def show(self, past: Sequence[Moment], at_once: bool = False) -> None:
        """Draw the last moment, with trails and plots of those before it; the plots only now and then,
        unless `at_once`.
        """
        now = past[-1]
        with self._server.atomic():
            self._say(now)
            self._show_arm(now)
            _draw(self._tip_trail, [one.tip for one in past])
            _draw(self._reference, [one.wanted for one in past])
            self.plots.show(past, at_once)

    def _say(self, now: Moment) -> None:
        set_value(self._valves, now.valves)
        set_value(self._state, _state(now))
        set_value(self._faults, "\n".join(now.faults) or "none")
        head = f"soro: {self._name} vented".replace("  ", " ") if now.latched else "soro"
        if head != self._head:
            self._head = head
            self._server.gui.set_panel_label(head)

    def _make_arm(self, length: float, radius: float) -> None:
        scene, own = self._server.scene, self._own
        straight = np.tile(np.eye(4), (2, 1, 1))
        straight[1, 2, 3] = length
        colours = self._skin.colours({})
        self._meshes = [
            scene.add_mesh_simple(f"{own}/arm/{name}", vertices, faces, color=_rgb(colour), visible=False)
            for name, faces, vertices, colour in zip(
                self._skin.names, self._skin.triangles, self._skin.vertices(straight), colours, strict=True
            )
        ]
        self._frames = [
            scene.add_frame(name, visible=False, axes_length=0.12 * length, axes_radius=0.003 * length)
            for name in (f"{own}/base", f"{own}/tip")
        ]
        self._force = scene.add_arrows(
            f"{own}/force",
            _NOTHING,
            _CONTACT,
            shaft_radius=0.08 * radius,
            head_radius=0.2 * radius,
            head_length=0.4 * radius,
            visible=False,
        )
        self._wanted = scene.add_icosphere(f"{own}/wanted", 0.15 * radius, color=_REFERENCE, visible=False)
        self._touching = (
            [
                scene.add_icosphere(
                    f"{own}/contact/{k}", 1.15 * radius, color=_CONTACT, opacity=0.5, visible=False
                )
                for k in range(self._robot.contacts.points_per_link * len(self._robot.links))
            ]
            if self._robot.contacts
            else []
        )
        self._reference = scene.add_line_segments(
            f"{own}/trail/reference", _NOTHING, _REFERENCE, thickness=2.0, thickness_units="screen"
        )
        self._tip_trail = scene.add_line_segments(
            f"{own}/trail/tip", _NOTHING, _TIP, thickness=4.0, thickness_units="screen"
        )

    def _make_surroundings(self, length: float) -> None:
        scene = self._server.scene
        scene.add_frame("/world", axes_length=0.2 * length, axes_radius=0.004 * length)
        scene.add_grid("/floor", 3 * length, 3 * length, cell_size=0.25 * length, section_size=length)
        contacts = self._robot.contacts
        for k, plane in enumerate(contacts.planes if contacts else ()):
            scene.add_box(
                f"{self._own}/obstacle/plane{k}",
                color=_OBSTACLE,
                opacity=0.5,
                dimensions=(2 * length, 2 * length, 1e-3 * length),
                wxyz=turned_to(plane.normal),
                position=np.asarray(plane.point),
            )
        for k, sphere in enumerate(contacts.spheres if contacts else ()):
            scene.add_icosphere(
                f"{self._own}/obstacle/sphere{k}",
                sphere.radius,
                color=_OBSTACLE,
                opacity=0.5,
                position=np.asarray(sphere.centre),
            )

    def _show_arm(self, now: Moment) -> None:
        poses, known = now.backbone, now.backbone is not None
        for item in (*self._meshes, *self._frames):
            item.visible = known
        self._wanted.visible = now.wanted is not None
        if now.wanted is not None:
            self._wanted.position = now.wanted
        self._force.visible = known and now.force is not None
        if poses is not None and now.force is not None:
            arrow = arrow_of(now.force, poses[-1, :3, 3], self._robot.length)
            self._force.points = arrow[None].astype(np.float32)
        part = {name: value / self._most_pa for name, value in now.pressure.items()}
        for mesh, colour in zip(self._meshes, self._skin.colours(part), strict=True):
            mesh.color = _rgb(colour)
        if poses is None:
            return
        vertices = self._skin.vertices(poses)
        if not self._vertices or any(
            np.abs(new - old).max() > _STEP_M for new, old in zip(vertices, self._vertices, strict=True)
        ):
            self._vertices = vertices
            for mesh, new in zip(self._meshes, vertices, strict=True):
                mesh.vertices = new.astype(np.float32)
            for frame, pose in zip(self._frames, (poses[0], poses[-1]), strict=True):
                x, y, z, w = quaternion_from_matrix(pose[:3, :3])
                frame.wxyz, frame.position = (w, x, y, z), pose[:3, 3]
        points = touching(self._robot, poses)
        for k, ball in enumerate(self._touching):
            ball.visible = k < len(points)
            if k < len(points):
                ball.position = points[k]


def _state(now: Moment) -> str:
    if now.backbone is None:
        return f"{now.t_s:.1f} s: no estimate of its shape"
    error = "" if np.isnan(now.error_m) else f", tip {now.error_m * 1e3:.1f} mm from its reference"
    return f"{now.t_s:.1f} s{error}{_force(now)}"


def _force(now: Moment) -> str:
    """Return the size of the force at the tip, and the stage of contact where it is not free."""
    if now.force is None:
        return ""
    stage = f" ({now.stage})" if now.stage not in ("", STAGES[0]) else ""
    return f", force {1e3 * np.linalg.norm(now.force):.0f} mN{stage}"


def set_value(handle: viser.GuiInputHandle[Value], value: Value) -> None:
    """Show a value in the panel."""
    handle.value = value  # type: ignore[misc]  # mypy does not see viser's setter: it is not next to its getter


def _draw(line: Any, points: list[Array | None]) -> None:
    """Draw a line through points [m], without what is not known."""
    known = np.array([point for point in points if point is not None])
    line.points = np.stack([known[:-1], known[1:]], axis=1) if len(known) > 1 else _NOTHING


def _rgb(colour: Array) -> tuple[int, int, int]:
    """Colour in steps of 1/64, so that noise of a pressure sends none."""
    r, g, b = (min(255, 4 * round(63.75 * float(part))) for part in colour)
    return r, g, b

"""The nodes between readings and commands of a run: estimator and controller, or an exciter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from soro_core.config import Strict, with_changes
from soro_core.grasping.settings import HandKeys
from soro_lab.scene import HandNodeConfig, Scene

# Nodes that look on: the arm goes on without them.
OBSERVERS = frozenset({"shadow", "markers", "recorder"})


@dataclass(frozen=True)
class LoopNodes:
    """The nodes between the readings and the commands of a run.

    Attributes
    ----------
    nodes : mapping of str to Strict
        Their parameters, by name, behind that of an arm of several: ``left/controller``.
    commander : str
        Name of the node of each arm that commands: it is enabled at the begin.
    shadow : bool
        Whether the twin runs beside a real arm.
    observers : frozenset of str
        Names of the nodes whose failure does not end the run.
    empties : bool
        Whether the commander ends the run itself, with an arm that it has emptied: any vent ends it too.
    """

    nodes: Mapping[str, Strict]
    commander: str
    shadow: bool = True
    observers: frozenset[str] = OBSERVERS
    empties: bool = False


def control_loop(scene: Scene) -> LoopNodes:
    """Return estimator and controller of each arm of a scene, and what moves them as a hand."""
    nodes: dict[str, Strict] = {}
    for arm in scene.each:
        nodes[f"{arm.prefix}estimator"] = arm.estimator_node()
        nodes[f"{arm.prefix}controller"] = with_changes(arm.controller_node(), hand=arm in scene.fingers)
    if scene.hand is not None:
        nodes["hand"] = _hand_node(scene, scene.hand)
    return LoopNodes(nodes, "controller")


def _hand_node(scene: Scene, hand: HandKeys) -> HandNodeConfig:
    """Return the parameters of the hand node."""
    return HandNodeConfig(
        mode=scene.mode,
        rate_hz=scene.rate_hz,
        model=scene.fingers[0].discretisation,
        fingers=tuple(arm.prefix.rstrip("/") for arm in scene.fingers),
        robots=tuple(arm.robot for arm in scene.fingers),
        **_carrier(scene),
        **dict(hand),
    )


def _carrier(scene: Scene) -> dict[str, Any]:
    """Return the parameters of the arm that carries a hand, if one does."""
    for name in scene.mounts.values():
        arm = scene.arms[name]
        return {"carrier": name, "carrier_robot": arm.robot, "carrier_model": arm.discretisation}
    return {}


def excitation_loop(scene: Scene) -> LoopNodes:
    """Return the exciter of a scene, which moves the arm for its recording.

    The model of a robot that is not identified yet is no shadow.
    """
    observers = OBSERVERS - {"recorder"}
    nodes = {"exciter": scene.exciter_node()}
    return LoopNodes(nodes, "exciter", shadow=False, observers=observers, empties=True)

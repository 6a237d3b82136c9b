"""The part of `launch` 3.4 and `launch_ros` 0.26 that our launch file uses, where these are not installed.

Names, keywords and their defaults are those of the packages; an action keeps what it was given.
"""

import sys
import types
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass(eq=False)
class DeclareLaunchArgument:
    name: str
    default_value: Any = field(kw_only=True, default=None)
    description: str | None = field(kw_only=True, default=None)
    choices: list[str] | None = field(kw_only=True, default=None)


@dataclass(eq=False, kw_only=True)
class OpaqueFunction:
    function: Callable[[Any], Any]


@dataclass(eq=False, kw_only=True)
class EmitEvent:
    event: Any


@dataclass(eq=False)
class RegisterEventHandler:
    event_handler: Any


@dataclass(eq=False, kw_only=True)
class Shutdown:
    reason: str = "reason not given"


@dataclass(eq=False, kw_only=True)
class ExecuteProcess:
    cmd: list[Any]
    name: str | None = None
    additional_env: dict[str, str] | None = None
    output: str = "log"
    sigterm_timeout: str = "5"
    on_exit: Any = None


@dataclass(eq=False, kw_only=True)
class Node:
    executable: str
    package: str | None = None
    name: str | None = None
    namespace: str | None = None
    parameters: list[Any] | None = None
    arguments: list[str] | None = None
    output: str = "log"
    sigterm_timeout: str = "5"
    on_exit: Any = None


@dataclass(eq=False, kw_only=True)
class LifecycleNode(Node):
    name: str
    namespace: str


@dataclass(eq=False, kw_only=True)
class OnProcessIO:
    target_action: Any = None
    on_stdout: Callable[[Any], Any] | None = None


@dataclass(eq=False, kw_only=True)
class OnStateTransition:
    entities: list[Any]
    target_lifecycle_node: LifecycleNode | None = None
    start_state: str | None = None
    goal_state: str | None = None


@dataclass(eq=False, kw_only=True)
class ChangeState:
    lifecycle_node_matcher: Callable[[Any], bool]
    transition_id: int


@dataclass(eq=False)
class ParameterValue:
    value: Any
    value_type: Any = field(kw_only=True, default=None)


@dataclass(frozen=True)
class ExecutableInPackage:
    executable: str
    package: str


@dataclass(frozen=True)
class FindPackageShare:
    package: str


@dataclass(frozen=True)
class PathJoinSubstitution:
    substitutions: list[Any]


@dataclass
class LaunchDescription:
    entities: list[Any]


def matches_action(target: Any) -> Callable[[Any], bool]:
    return lambda action: action is target


MODULES = {
    "launch": (LaunchDescription,),
    "launch.actions": (
        DeclareLaunchArgument,
        EmitEvent,
        ExecuteProcess,
        OpaqueFunction,
        RegisterEventHandler,
        Shutdown,
    ),
    "launch.event_handlers": (OnProcessIO,),
    "launch.events": (matches_action,),
    "launch.substitutions": (PathJoinSubstitution,),
    "launch_ros": (),
    "launch_ros.actions": (LifecycleNode, Node),
    "launch_ros.event_handlers": (OnStateTransition,),
    "launch_ros.events": (),
    "launch_ros.events.lifecycle": (ChangeState,),
    "launch_ros.parameter_descriptions": (ParameterValue,),
    "launch_ros.substitutions": (ExecutableInPackage, FindPackageShare),
}


def load(file: Path) -> types.ModuleType:
    """Run a launch file with these names in place of the packages."""
    before = {name: sys.modules.get(name) for name in MODULES}
    for name, members in MODULES.items():
        module = types.ModuleType(name)
        vars(module).update({member.__name__: member for member in members})
        sys.modules[name] = module
    try:
        loaded = types.ModuleType(file.stem)
        exec(compile(file.read_text(), str(file), "exec"), vars(loaded))
        return loaded
    finally:
        for name, module in before.items():
            if module is None:
                del sys.modules[name]
            else:
                sys.modules[name] = module

"""Installed message types by name: their classes, definitions and hashes; quality of service both ways."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    QoSProfile,
    ReliabilityPolicy,
)
from rclpy.topic_endpoint_info import TopicEndpointInfo

from soro_core.errors import ConfigError
from soro_lab.bag import INFINITE_NS, Definition, Qos, Span, find_definition


def topic_pattern(node: Node, entry: str, key: str) -> str:
    """Return the full name of a topic in a parameter; patterns (``*``, ``?``, ``[``) are not changed.

    Parameters
    ----------
    node : Node
    entry : str
    key : str
        Name of the parameter, for errors.

    Raises
    ------
    ConfigError
        If the entry is not a topic name.
    """
    if any(sign in entry for sign in "*?["):
        return entry
    try:
        return str(node.resolve_topic_name(entry, only_expand=True))
    except Exception:  # rclpy has several
        where = f"parameters of {node.get_name()}"
        raise ConfigError(where, key, entry, "a topic name, or a pattern like /arm/*") from None


def message_class(type_name: str) -> type[Any] | None:
    """Return the class of ``package/msg/Name``; None where it is not installed."""
    package, _, name = type_name.replace("/", ".").rpartition(".")
    if "." not in package:
        package = f"{package}.msg"
    try:
        found = getattr(importlib.import_module(package), name, None)
    except (ImportError, ValueError):
        return None
    # A bag may name any class of any package.
    return found if isinstance(found, type) and hasattr(found, "get_fields_and_field_types") else None


def type_name(kind: type[Any]) -> str:
    """Return ``package/msg/Name`` of a class of messages."""
    return f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}"


def definition(type_name: str) -> Definition:
    """Return the definition and the hash of an installed type; texts are empty where files are missing."""
    return find_definition(type_name, share_folders(type_name))


def share_folders(type_name: str) -> tuple[Path, ...]:
    """Return the folders in which the package of a type may have its share folder.

    In a sourced ROS those of AMENT_PREFIX_PATH; with wheels the one of the environment in which the
    package lies (ament_index_python does not find it).
    """
    prefixes = [Path(item) for item in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if item]
    package = type_name.split("/", 1)[0]
    try:
        module = importlib.import_module(package)
    except ImportError:
        module = None
    if module is not None and module.__file__:
        prefixes.extend(Path(module.__file__).resolve().parents)
    prefixes.append(Path(sys.prefix))
    return tuple(dict.fromkeys(share for prefix in prefixes if (share := prefix / "share").is_dir()))


def offered(endpoints: Sequence[TopicEndpointInfo]) -> tuple[Qos, ...]:
    """Return what the publishers of a topic offer, each different profile once."""
    return tuple(dict.fromkeys(_from_profile(endpoint.qos_profile) for endpoint in endpoints))


def request(offers: Sequence[Qos]) -> QoSProfile:
    """Return the strictest quality of service that matches all publishers, with an unbounded history.

    Like rosbag2: reliable and transient local only where every publisher offers that.
    """
    reliable = all(offer.reliability == "reliable" for offer in offers)
    latched = bool(offers) and all(offer.durability == "transient_local" for offer in offers)
    return QoSProfile(
        history=HistoryPolicy.KEEP_ALL,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def offer(recorded: Sequence[Qos], depth: int, keep_all: bool) -> QoSProfile:
    """Return the quality of service with which a recorded topic is published again.

    Parameters
    ----------
    recorded : sequence of Qos
        What its publishers offered. Where they differ, the default of rosbag2: reliable and volatile.
    depth : int
        History where the recorded one is unknown.
    keep_all : bool
        Nothing may be overwritten before readers have it (playing as fast as possible).
    """
    same = {(qos.reliability, qos.durability) for qos in recorded}
    first = recorded[0] if len(same) == 1 else Qos(depth=0)
    latched = first.durability == "transient_local"
    known = first.history == "keep_last" and first.depth > 0
    profile = QoSProfile(
        # A latched writer keeps its history for late joiners: it has to be bounded.
        history=HistoryPolicy.KEEP_ALL if keep_all and not latched else HistoryPolicy.KEEP_LAST,
        depth=first.depth if known and latched else depth,
        reliability=_named(ReliabilityPolicy, first.reliability, ReliabilityPolicy.RELIABLE),
        durability=_named(DurabilityPolicy, first.durability, DurabilityPolicy.VOLATILE),
    )
    # An expired deadline only raises events, but readers that ask for one match only if it is offered.
    if 0 < first.deadline.nanoseconds < INFINITE_NS:
        profile.deadline = Duration(nanoseconds=first.deadline.nanoseconds)
    return profile


def _from_profile(profile: QoSProfile) -> Qos:
    return Qos(
        history=_name(profile.history),
        depth=profile.depth,
        reliability=_name(profile.reliability),
        durability=_name(profile.durability),
        deadline=Span.of(profile.deadline.nanoseconds),
        lifespan=Span.of(profile.lifespan.nanoseconds),
        liveliness=_name(profile.liveliness),
        liveliness_lease=Span.of(profile.liveliness_lease_duration.nanoseconds),
        avoid_ros_namespace_conventions=profile.avoid_ros_namespace_conventions,
    )


def _name(policy: Any) -> str:
    return str(policy.name).lower()


def _named(policies: Any, name: str, default: Any) -> Any:
    found = policies.__members__.get(name.upper(), default)
    return default if found in (policies.UNKNOWN, policies.SYSTEM_DEFAULT) else found

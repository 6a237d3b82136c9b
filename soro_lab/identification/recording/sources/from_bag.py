"""Recordings in bags: chambers/state, chambers/command, sensors/pose0 ... and sensors/imu0 ... of one arm."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from soro_core.arrays import Array
from soro_core.config import read_yaml
from soro_core.errors import BagError, ConfigError
from soro_core.robot import Robot
from soro_lab.identification.recording.clean import Raw, raw, usable, without_stale
from soro_lab.identification.recording.place import Place, place_of_part
from soro_lab.identification.recording.recording import Recording
from soro_lab.identification.recording.sources.from_csv import pressure_limits
from soro_lab.identification.recording.stale import StaleLimits
from soro_lab.identification.recording.streams import Imu, Plate, Series, Stream
from soro_lab.run_folder import bag_of

if TYPE_CHECKING:
    from soro_lab.bag import Topic
    from soro_lab.bag.decode import Fields


_STATE, _COMMAND = "chambers/state", "chambers/command"
_SENSOR = re.compile(r"sensors/(pose|imu)(\d+)")
_JOINT_STATE = "sensor_msgs/msg/JointState"
_TYPES = {"pose": "geometry_msgs/msg/PoseStamped", "imu": "sensor_msgs/msg/Imu"}
_SCENES = ("scene_used.yaml", "scene.yaml")


def read_bag(
    path: str | Path,
    robot: Robot,
    places: Mapping[str, Place] | None = None,
    namespace: str | None = None,
    limits: StaleLimits | None = None,
) -> Recording:
    """Read a bag as `soro run` or a lab with the same topics leaves it.

    Parameters
    ----------
    path : path
        Folder of the bag or of the run, or an MCAP file.
    robot : Robot
        Robot of the recording, which names the chambers.
    places : mapping of str to Place, optional
        Places of sensors by topic (``sensors/pose0``); they precede those of a scene file beside the bag.
        Without both, sensors/pose0 and sensors/imu0 are taken to sit at the tip, which `notes` states.
    namespace : str, optional
        Namespace of the arm, where the bag has several.
    limits : StaleLimits, optional
        When readings are repeated or frozen.

    Raises
    ------
    ConfigError
        If pressures are missing, chambers have other names, a place is not known, or a stream has
        no usable samples.
    BagError
        If the bag cannot be read.
    """
    from soro_lab.bag import BagReader  # its packages are those of the extra `ros`
    from soro_lab.bag.decode import Decoder

    folder = bag_of(Path(path))
    where = str(folder)
    with BagReader(folder) as reader:
        reader.check_encodings()
        counted = zip(reader.topics, reader.counts, strict=True)
        # A twin without IMUs still announces their topic.
        types = {topic.name: topic.type for topic, count in counted if count}
        prefix = _prefix(types, namespace, where)
        sensors = _sensors(types, prefix, where)
        known = _places(folder, robot, places or {}, sensors)
        wanted = {prefix + name for name in (_STATE, _COMMAND, *sensors) if prefix + name in types}
        decoders = {}
        for topic in (topic for topic in reader.topics if topic.name in wanted):
            decoders[topic.name] = Decoder(topic, folder)
            expected = Decoder(replace(topic, definition=""), folder)
            _check_fields(topic, decoders[topic.name].fields, expected.fields, folder)
        messages: dict[str, list[Any]] = {name: [] for name in sorted(wanted)}
        unread: dict[str, tuple[int, BagError]] = {}
        for item in reader.messages(wanted):
            try:
                messages[item.topic].append(decoders[item.topic](item.data))
            except BagError as error:
                count, first = unread.get(item.topic, (0, error))
                unread[item.topic] = count + 1, first
        for name, (_, first) in unread.items():
            if not messages[name]:
                raise first
        notes = (
            *reader.problems,
            *(
                f"{name}: {count} of {reader.count(name)} messages left out: {first.text}"
                for name, (count, first) in unread.items()
            ),
        )
    efforts = {
        stream: _efforts(messages[prefix + name], robot, where, prefix + name)
        for stream, name in (("pressure", _STATE), ("command", _COMMAND))
        if prefix + name in messages
    }
    start_ns = efforts["pressure"][0][0]
    found = [_pressures(stream, *rows, robot, start_ns) for stream, rows in efforts.items()]
    frames = set()
    for name in sensors:
        samples = messages[prefix + name]
        frames |= {sample.header.frame_id for sample in samples if "pose" in name}
        found.append(raw(_sensor(name, samples, known[name][0], start_ns)))
    cleaned = without_stale([usable(each, where) for each in found], ("command",), limits)
    streams = [stream for stream, _ in cleaned]
    series = {stream.name: stream for stream in streams if isinstance(stream, Series)}
    recording = Recording(
        name=folder.parent.name if folder.name == "bag" else folder.stem,
        chambers=robot.chamber_names,
        pressure=series["pressure"],
        command=series.get("command"),
        plates=tuple(s for s in streams if isinstance(s, Plate)),
        imus=tuple(s for s in streams if isinstance(s, Imu)),
        frame=", ".join(sorted(frames)) or "world",
        faults=tuple(faults for _, faults in cleaned),
        notes=(*notes, *(note for _, note in known.values() if note)),
    )
    _check_clocks(recording, where)
    return recording


def _check_fields(topic: Topic, fields: Fields, known: Fields, bag: Path) -> None:
    """Refuse a type that was recorded with a definition without the fields that are read."""
    from soro_lab.bag.decode import holds

    for name, listed in known.items():
        recorded = dict(fields.get(name, ()))
        for field, text in listed:
            if not holds(text, recorded.get(field, "missing")):
                got = f"{name}.{field} is {recorded.get(field, 'missing')} in its definition"
                raise BagError(f"{got}; allowed: {text}", bag, "value", topic.name)


def _check_clocks(recording: Recording, where: str) -> None:
    """Refuse poses that were stamped by another clock than the pressures."""
    first, last = recording.pressure.t[[0, -1]]
    for plate in recording.plates:
        if plate.t[0] >= last or plate.t[-1] <= first:
            got = f"stamps from {plate.t[0]:.3f} to {plate.t[-1]:.3f} s after the first pressure"
            raise ConfigError(
                where, plate.name, got, f"stamps of the clock of the pressures, {first:.3f} to {last:.3f} s"
            )


def _prefix(types: Mapping[str, str], namespace: str | None, where: str) -> str:
    """Return the namespace of the arm with a slash at both ends."""
    ending = f"/{_STATE}"
    found = [name.removesuffix(_STATE) for name in types if name.endswith(ending)]
    if namespace is not None:
        wanted = f"/{namespace.strip('/')}/" if namespace.strip("/") else "/"
        if wanted not in found:
            allowed = ", ".join(prefix.strip("/") or "/" for prefix in found) or f"a bag with {_STATE}"
            raise ConfigError(where, "namespace", namespace, allowed)
        return wanted
    if not found:
        raise ConfigError(where, _STATE, f"topics {', '.join(types) or 'none'}", f"pressures on {_STATE}")
    if len(found) > 1:
        names = ", ".join(prefix.strip("/") or "/" for prefix in found)
        raise ConfigError(where, "namespace", f"pressures of {len(found)} arms", f"one of {names}")
    if types[found[0] + _STATE] != _JOINT_STATE:
        raise ConfigError(where, found[0] + _STATE, types[found[0] + _STATE], _JOINT_STATE)
    return found[0]


def _sensors(types: Mapping[str, str], prefix: str, where: str) -> list[str]:
    """Return the topics of poses and IMUs without the namespace, in the order of their numbers."""
    found = []
    for topic, type_name in types.items():
        match = _SENSOR.fullmatch(topic.removeprefix(prefix)) if topic.startswith(prefix) else None
        if match is None:
            continue
        if type_name != _TYPES[match[1]]:
            raise ConfigError(where, topic, type_name, _TYPES[match[1]])
        found.append((match[1] == "imu", int(match[2]), match[0]))
    return [name for _, _, name in sorted(found)]


def _places(
    bag: Path, robot: Robot, given: Mapping[str, Place], sensors: list[str]
) -> dict[str, tuple[Place, str]]:
    """Return the place of each sensor, and a note where it is assumed."""
    for name in given:
        if name not in sensors:
            raise ConfigError(str(bag), name, "no such topic", f"places of {', '.join(sensors)}")
    file = next((f for d in (bag, bag.parent) for n in _SCENES if (f := d / n).is_file()), None)
    twin = read_yaml(file).get("twin") if file else None
    found: dict[str, tuple[Place, str]] = {}
    for name in sensors:
        kind, number = "pose" if "pose" in name else "imu", int(re.sub(r"\D", "", name))
        parts = _locations(twin, kind) if file else ()
        if name in given:
            found[name] = given[name], ""
        elif number < len(parts):
            found[name] = place_of_part(robot, parts[number]), ""
        elif number == 0:
            found[name] = Place(len(robot.links) - 1), f"{name} is taken to sit at the tip: no file states it"
        else:
            allowed = f"its place: an option, or twin.{kind}.locations in scene_used.yaml beside the bag"
            raise ConfigError(str(bag), name, "no place", allowed)
    return found


def _locations(twin: object, kind: str) -> tuple[float, ...]:
    """Return the places that the scene of a run states, as parts of the arm's length."""
    section = twin.get(kind) if isinstance(twin, dict) else None
    stated = section.get("locations") if isinstance(section, dict) else None
    if isinstance(section, dict) and stated is None and "location" in section:
        stated = [section["location"]]
    numbers = stated if isinstance(stated, list) else []
    return tuple(float(n) for n in numbers if isinstance(n, int | float) and 0.0 <= n <= 1.0)


def _efforts(messages: list[Any], robot: Robot, where: str, topic: str) -> tuple[list[int], Array]:
    """Return stamps [ns] and pressures (n, n_u) [Pa] in the robot's order."""
    chambers = robot.chamber_names
    rows, stamps = [], []
    for message in messages:
        # In lockstep an empty message says that there is no command at this tick.
        if not message.name and not message.effort.size:
            continue
        given = dict(zip(message.name, message.effort, strict=False))
        if set(given) != set(chambers) or len(message.effort) != len(chambers):
            got = f"{', '.join(message.name) or 'no names'} with {len(message.effort)} efforts"
            raise ConfigError(where, topic, got, f"one effort each of {', '.join(chambers)}")
        rows.append([given[chamber] for chamber in chambers])
        stamps.append(_stamp_ns(message))
    if not rows:
        raise ConfigError(where, topic, "no pressures", f"pressures of {', '.join(chambers)}")
    return stamps, np.array(rows, dtype=np.float64)


def _pressures(name: str, stamps: list[int], values: Array, robot: Robot, start_ns: int) -> Raw:
    low, high = pressure_limits(robot)
    outside = ((values < low) | (values > high)).any(axis=1)
    return raw(Series(name, _seconds(stamps, start_ns), values), None, outside)


def _sensor(name: str, samples: list[Any], place: Place, start_ns: int) -> Stream:
    t = _seconds([_stamp_ns(sample) for sample in samples], start_ns)
    if "pose" in name:
        poses = [sample.pose for sample in samples]
        positions = np.array([[getattr(pose.position, axis) for axis in "xyz"] for pose in poses])
        return Plate(name, t, place, positions, _turns(poses))
    gyro, accel = (
        np.array([[getattr(getattr(sample, field), axis) for axis in "xyz"] for sample in samples])
        for field in ("angular_velocity", "linear_acceleration")
    )
    # REP 145: the first number of the covariance is -1 without an orientation.
    known = samples[0].orientation_covariance[0] >= 0.0
    return Imu(name, t, place, gyro, accel, _turns(samples) if known else None)


def _turns(oriented: list[Any]) -> Array:
    """Return the quaternions x, y, z, w of poses or IMUs, (n, 4)."""
    return np.array([[getattr(each.orientation, axis) for axis in "xyzw"] for each in oriented])


def _stamp_ns(message: Any) -> int:
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


def _seconds(stamps_ns: list[int], start_ns: int) -> Array:
    # Differences of whole nanoseconds: seconds since 1970 as a float have steps of 0.2 us.
    return np.array([stamp - start_ns for stamp in stamps_ns], dtype=np.float64) * 1e-9

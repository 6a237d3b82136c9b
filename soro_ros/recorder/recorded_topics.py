"""The topics that the bag of a run holds."""

from __future__ import annotations

from soro_lab.scene import Scene

# Topics of the control loop, with their types, so that the recorder subscribes before the first message.
_TOPICS = (
    ("chambers/command", "sensor_msgs/msg/JointState"),
    ("chambers/state", "sensor_msgs/msg/JointState"),
    ("exciter/section", "sensor_msgs/msg/JointState"),
    ("arm/state", "sensor_msgs/msg/JointState"),
    ("arm/tip", "geometry_msgs/msg/PoseWithCovarianceStamped"),
    ("arm/wrench", "geometry_msgs/msg/WrenchStamped"),
    ("arm/wrench/covariance", "sensor_msgs/msg/JointState"),
    ("arm/shadow/tip", "geometry_msgs/msg/PoseStamped"),
    ("arm/shadow/difference", "sensor_msgs/msg/JointState"),
    ("arm/desired/tip", "geometry_msgs/msg/PoseStamped"),
    ("arm/configured/tip", "geometry_msgs/msg/PoseStamped"),
    ("arm/desired/wrench", "geometry_msgs/msg/WrenchStamped"),
    ("arm/covariance", "sensor_msgs/msg/JointState"),
    ("arm/learned", "sensor_msgs/msg/JointState"),
    ("controller/estimates", "sensor_msgs/msg/JointState"),
    ("controller/deviations", "sensor_msgs/msg/JointState"),
    ("controller/terms", "sensor_msgs/msg/JointState"),
    ("truth/tip", "geometry_msgs/msg/PoseStamped"),
    ("truth/state", "sensor_msgs/msg/JointState"),
    ("truth/chambers", "sensor_msgs/msg/JointState"),
    ("truth/wrench", "geometry_msgs/msg/WrenchStamped"),
    ("external/wrench", "geometry_msgs/msg/WrenchStamped"),
    ("base/pose", "geometry_msgs/msg/PoseStamped"),
)
_BACKBONE, _DIAGNOSTICS = "geometry_msgs/msg/PoseArray", "diagnostic_msgs/msg/DiagnosticArray"


def recorded_topics(scene: Scene) -> tuple[str, ...]:
    """Return the topics of a scene as the recorder takes them: name, type, and how long messages are kept."""
    lockstep = scene.mode == "lockstep"
    kept = " transient_local" if lockstep else ""  # as qos.loop() has it
    clock = [f"/clock rosgraph_msgs/msg/Clock{kept}"] if lockstep else []
    named = [topic for arm in scene.each for topic in _of_arm(arm, kept)]
    backbones = [f"/{arm.name}/arm/backbone {_BACKBONE}" for arm in scene.each]
    named += _of_bodies(scene, kept)
    for arm in scene.each:  # the encoder of a real joint may be anywhere
        topic = arm.controller.joint
        name = topic if topic.startswith("/") else f"/{arm.name}/{topic}"
        if topic and not any(one.startswith(f"{name} ") for one in named):
            named.append(f"{name} sensor_msgs/msg/JointState{kept}")
    return (*named, *clock, *backbones, f"/diagnostics {_DIAGNOSTICS}", f"/{scene.name}/*")


def _of_bodies(scene: Scene, kept: str) -> list[str]:
    if not scene.bodies:
        return []
    kinds = ("pose", "geometry_msgs/msg/PoseStamped"), ("wrench", "geometry_msgs/msg/WrenchStamped")
    place = f"/{scene.name}/bodies"
    topics = [f"{place}/{name}/{topic} {kind}{kept}" for name in scene.bodies for topic, kind in kinds]
    joints = [name for name, body in scene.bodies.items() if body.hinge is not None]
    topics += [f"{place}/{name}/joint sensor_msgs/msg/JointState{kept}" for name in joints]
    return [*topics, f"{place}/contacts sensor_msgs/msg/JointState{kept}"]


def _of_arm(scene: Scene, kept: str) -> list[str]:
    sensors = [
        (f"sensors/{name}{k}", kind)
        for name, kind, places in (
            ("pose", "geometry_msgs/msg/PoseStamped", scene.twin.pose.locations),
            ("imu", "sensor_msgs/msg/Imu", scene.twin.imu.locations),
        )
        for k in range(len(places))
    ]
    return [f"/{scene.name}/{topic} {kind}{kept}" for topic, kind in (*_TOPICS, *sensors)]

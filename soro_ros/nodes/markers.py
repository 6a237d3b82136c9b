"""The markers node: the arm on arm/markers for RViz and Foxglove."""

from __future__ import annotations

from visualization_msgs.msg import Marker, MarkerArray

from soro_core.robot import load_robot
from soro_lab.scene import MarkersConfig
from soro_ros.conversion import qos
from soro_ros.process.lifecycle import SoroNode
from soro_ros.process.node_process import run_node
from soro_ros.topics.diagnostics import OK
from soro_ros.topics.ports import subscribe
from soro_ros.view.markers import TOPIC, ArmMarkers


class MarkersNode(SoroNode[MarkersConfig]):
    """Draws the newest messages of an arm at a steady rate, while somebody looks."""

    config_model = MarkersConfig
    node_name = "markers"
    is_observer = True

    def setup(self, config: MarkersConfig) -> None:
        self._config, self._drawn = config, 0
        self._markers = ArmMarkers(load_robot(config.robot), config)
        self._publisher = self.create_publisher(MarkerArray, TOPIC, qos.NEWEST)
        subscribe(self, self._markers.inputs, lockstep=False)

    def start(self) -> None:
        self.every(1.0 / self._config.rate_hz, self._draw)

    def stop(self) -> None:
        self._publisher.publish(MarkerArray(markers=[Marker(action=Marker.DELETEALL)]))

    def _draw(self) -> None:
        if self._publisher.get_subscription_count() and (drawn := self._markers.take()) is not None:
            self._publisher.publish(drawn)
            self._drawn += 1

    def diagnose(self) -> None:
        status = self.diagnostics.status
        self.diagnostics.update(OK, status.message, {"drawn": self._drawn})


def main() -> None:
    """Entry point of `ros2 run soro_ros markers`."""
    run_node(MarkersNode)


if __name__ == "__main__":
    main()

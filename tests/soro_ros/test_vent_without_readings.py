"""`soro vent` where no readings come any more: the driver needs a command of zero before a reset."""

import pytest

from soro_ros.nodes.controller import ControllerNode
from soro_ros.nodes.exciter import ExciterNode
from tests.soro_ros.direct import active, captured, request


@pytest.mark.parametrize(
    ("node_class", "setting"), [(ControllerNode, "enabled:=true"), (ExciterNode, "pose_rate_hz:=100.0")]
)
def test_a_node_that_hears_nothing_commands_zero_once_when_it_is_vented(domain, node_class, setting):
    with active(node_class, setting) as node:
        commands = captured(node, "chambers/command")
        assert request(node, "~/vent").success
        assert [list(one.effort) for one in commands] == [[0.0, 0.0, 0.0]]

"""The view as a person has it: a headless Chromium on it, and valves that its button vents."""

import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip("viser", reason="the extra `view` is not installed")

from geometry_msgs.msg import PoseArray

from soro_ros.conversion import messages
from tests.soro_ros.bench import PERIOD_S, Bench
from tests.soro_ros.conftest import own_domain
from tests.soro_ros.running import end
from tests.soro_ros.view import browser as chromium

pytestmark = [
    pytest.mark.skipif(chromium.PROGRAM is None, reason="no chromium (Debian's package) is installed"),
    pytest.mark.process,
]


@pytest.fixture
def bench(tmp_path, tmp_path_factory):
    """Emulated valves and their regulator, in lockstep."""
    with own_domain(tmp_path_factory.mktemp("state")):
        it = Bench(tmp_path, lockstep=True)
        yield it
        assert set(it.close()) == {0}


@pytest.fixture
def address(bench, tmp_path):
    """Address of a viewer of these valves, with its token."""
    told = tmp_path / "address"
    command = [sys.executable, "-m", "soro_ros.nodes.viewer", "--ros-args", "-r", "__ns:=/bench"]
    process = subprocess.Popen(
        [*command, "-p", f"address_file:={told}", "-p", "port:=18380", "-p", "rate_hz:=5.0"]
    )
    try:
        chromium.until(lambda: told.exists() and told.read_text(), "an address")
        assert told.stat().st_mode & 0o777 == 0o600
        yield told.read_text()
    finally:
        assert end(process)[0] == 0


@pytest.fixture
def pass_time(bench):
    """Let a cycle pass in which pressures are commanded and an estimate of the straight arm is published."""
    backbone = bench.node.create_publisher(PoseArray, "arm/backbone", 10)
    poses = np.tile(np.eye(4), (5, 1, 1))
    poses[:, 2, 3] = np.linspace(0.0, 0.0925, 5)
    message = PoseArray(poses=[messages.pose_of(pose) for pose in poses])

    def cycle() -> None:
        bench.send([40e3, 20e3, 0.0], PERIOD_S)
        backbone.publish(message)

    return cycle


@pytest.mark.timeout(600)  # the browser draws without a graphics card
def test_a_browser_shows_the_arm_and_its_button_vents_only_with_the_token(
    bench, address, pass_time, tmp_path
):
    with chromium.browser(tmp_path / "profile") as page:

        def shows(text: str) -> None:
            chromium.until(lambda: pass_time() or text in page.text(), text)

        page.open(address.partition("?")[0])
        shows("Without buttons")
        page.click("vent")
        shows("Refused")
        assert not bench.failed()
        page.open(address)
        shows("open")
        assert "token" not in page.ask("location.href")
        chromium.until(lambda: pass_time() or bellow(page.picture()) > 100, "a bellow under pressure")
        page.click("vent")
        assert "vent" in bench.fault()
        bench.wait_empty()
        chromium.until(lambda: "vented" in page.text(), "the cause")


def bellow(picture: np.ndarray) -> int:
    """Pixels of the blue of the first chamber, left of the panel."""
    red, green, blue = np.moveaxis(picture[:, :450].astype(int), 2, 0)
    return int(np.sum((blue > red + 40) & (green > red + 10)))  # no axis, which is pure blue

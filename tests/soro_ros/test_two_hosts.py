"""Twin and controller on two hosts: what a cut of their cable does."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from soro_ros.host import middleware
from tests.soro_ros import two_hosts

pytestmark = pytest.mark.process

# Longer than any run of it [s]: an end with what was printed, before the test itself is ended.
HANG_S = 240
# Ages that a busy machine does not reach.
_LOOP = ("rate_hz:=50.0", "priority:=0")
_TWIN = (*_LOOP, "twin:limits.command_age_s:=0.5", "twin:pose.rate_hz:=50.0", "twin:refine:=1")
_CONTROLLER = (
    *_LOOP,
    "platform:=''",
    "state_age_s:=0.4",
    "control.reference.kind:=circle",
    "control.reference.start_s:=0.5",
    "control.probe_at_enable:='off'",
)


def _node(module: str, *words: str, settings: tuple[str, ...]) -> str:
    options = [part for one in settings for part in ("-p", one)]
    command = [sys.executable, "-m", f"soro_ros.nodes.{module}", *words]
    return shlex.join([*command, "--ros-args", "-r", "__ns:=/hosts", *options])


@pytest.mark.real_time
def test_a_cut_of_the_cable_vents_until_a_reset(domain, tmp_path, monkeypatch):
    """Both have chosen `SUBNET` (ADR 0015). Commands that come again after a second press nothing."""
    if not two_hosts.possible():
        pytest.skip("no network namespaces here (unshare, ip, nsenter)")
    for name in middleware.CHOICES:
        monkeypatch.delenv(name, raising=False)
    chosen = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET", "PYTHONPATH": str(Path(__file__).parents[2])}
    (tmp_path / "remote.sh").write_text("exec " + _node("controller", settings=_CONTROLLER))
    twin = _node("arm", "twin", "estimator", settings=_TWIN)
    script = f"{two_hosts.CABLED}\nexec {shlex.quote(sys.executable)} -m tests.soro_ros.cut_cable {twin}"
    done = subprocess.run(
        [*two_hosts.ISOLATED, "bash", "-c", script],
        cwd=tmp_path,
        env={**os.environ, **chosen},
        capture_output=True,
        text=True,
        timeout=HANG_S,
    )
    assert done.returncode == 0, done.stderr + (tmp_path / "remote.err").read_text()
    found = json.loads(done.stdout.splitlines()[-1])
    assert not found["before"]
    assert "command lost" in found["cut"]
    assert "command lost" in found["again"]

"""Configuration models as ROS parameters, on real nodes in processes of their own."""

import signal
import subprocess
import sys
import textwrap

import pytest

from soro_ros.host import middleware
from tests.patience import LIMIT_S
from tests.refused import refused_keys

NODE = textwrap.dedent(
    """
    from pydantic import Field
    from soro_core.config import Floats, Strict
    from soro_core.run_keys import StartKeys
    from soro_ros.process.lifecycle import SoroNode
    from soro_ros.process.node_process import run_node

    class Inner(Strict):
        gain: float = Field(1.0, ge=0, description="gain")
        free: float | None = Field(None, description="free")
        list: Floats = Field((1.0, 2.0), description="list")

    class Config(StartKeys):
        rate_hz: float = Field(200.0, gt=0, le=1000, description="rate")
        inner: Inner = Inner()

    class Example(SoroNode[Config]):
        config_model, node_name = Config, "example"
        def setup(self, config):
            print("setup", config, flush=True)
        def start(self):
            self.every(0.02, lambda: print("tick", flush=True))
        def make_safe(self):
            print("safe", flush=True)

    run_node(Example)
    """
)


def run(*arguments: str, until: str = "tick", number: int = signal.SIGINT) -> tuple[int, str, str]:
    """Run the node until it prints a word, then end it by a signal."""
    process = subprocess.Popen(
        [sys.executable, "-c", NODE, "--ros-args", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    seen = []
    for line in process.stdout:
        seen.append(line)
        if line.startswith(until):
            process.send_signal(number)
            break
    out, err = process.communicate(timeout=LIMIT_S)
    return process.returncode, "".join(seen) + out, err


@pytest.mark.process
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_defaults_timer_and_a_clean_end_on_a_signal(domain, number):
    status, out, err = run(number=number)
    assert status == 0, err
    assert "rate_hz=200.0 inner=Inner(gain=1.0, free=None, list=(1.0, 2.0))" in out
    assert out.rstrip().endswith("safe")


@pytest.mark.process
def test_overrides_reach_nested_models_and_integers_serve_as_floats(domain):
    status, out, err = run("-p", "rate_hz:=100", "-p", "inner.list:=[3.0]", "-p", "inner.gain:=2.5")
    assert status == 0, err
    assert "rate_hz=100.0 inner=Inner(gain=2.5, free=None, list=(3.0,))" in out


@pytest.mark.process
def test_an_empty_list_is_one_from_a_file_and_from_the_command_line(domain, tmp_path):
    file = tmp_path / "given.yaml"
    file.write_text("/**: {ros__parameters: {inner: {list: []}}}\n")
    for arguments in (("--params-file", str(file)), ("-p", "inner.list:=[]", "-p", "inner.free:=[]")):
        status, out, err = run(*arguments)
        assert status == 0, err
        assert "inner=Inner(gain=1.0, free=None, list=())" in out


@pytest.mark.process
@pytest.mark.parametrize(
    ("setting", "key", "names"),
    [
        ("rate:=1.0", "rate", ("autostart", "inner.free")),
        ("inner.gain:=-1.0", "inner.gain", ("-1.0",)),
        ("inner.gain:=.nan", "inner.gain", ("nan",)),
        ("rate_hz:=fast", "rate_hz", ("'fast'",)),
        ("rate_hz:=[]", "rate_hz", ("None",)),
        ("inner.lists:=[]", "inner.lists", ("inner.list",)),
        ("inner.list:=[a, b]", "inner.list[0]", ("'a'",)),
    ],
)
def test_a_wrong_parameter_is_one_line_and_exit_status_2(node_main, setting, key, names):
    ended = node_main(lambda: exec(NODE, {"__name__": "example"}), "--ros-args", "-p", setting)
    assert ended.status == 2
    assert set(refused_keys(ended.err)) == {key}
    assert all(name in ended.err for name in names), ended.err
    assert "Traceback" not in ended.err
    assert "tick" not in ended.out


@pytest.mark.process
def test_a_process_with_a_wrong_parameter_ends_with_status_2(domain):
    status, out, err = run("-p", "rate:=1.0")
    assert status == 2
    assert refused_keys(err) == ["rate"]
    assert "Traceback" not in err
    assert "tick" not in out


@pytest.mark.process
def test_a_node_that_fails_reports_one_line(domain):
    """Its executor printed a traceback besides."""
    fails = NODE.replace('print("tick", flush=True)', "fails()").replace(
        "class Inner", "def fails():\n    raise SoroError('the emulator has gone')\n\nclass Inner"
    )
    program = f"from soro_core.errors import SoroError\n{fails}"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stdout.rstrip().endswith("safe")
    (said,) = done.stderr.splitlines()
    assert said.endswith("the emulator has gone")


@pytest.mark.parametrize(
    ("value", "stalls"), [("LOCALHOST", True), ("localhost", True), ("SUBNET", False), ("", False)]
)
def test_an_environment_that_delays_messages_is_a_warning(monkeypatch, value, stalls):
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", value)
    assert bool(middleware.stall_warning()) is stalls

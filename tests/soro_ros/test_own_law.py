"""Laws from outside by `soro run`: that of docs/adding_a_law.md, one that fails, and those of packages."""

import os
import re
import shutil

import pytest

from tests.docs.test_pages import ROOT
from tests.law_packages import paths_of
from tests.soro_ros.running import run, summary

PAGE = (ROOT / "docs/adding_a_law.md").read_text(encoding="utf-8")

pytestmark = [pytest.mark.usefixtures("domain"), pytest.mark.slow]


@pytest.fixture
def scene(tmp_path):
    """The two files of the page."""
    (name,) = re.findall(r"^    soro run (\S+)$", PAGE, re.M)
    (tmp_path / name).write_text(re.search(r"```yaml\n(.*?)```", PAGE, re.S).group(1))
    shutil.copy(ROOT / "examples/spring_law.py", tmp_path / "my_law.py")
    return tmp_path / name


def test_the_law_of_the_page_runs(scene, tmp_path):
    status, said, folder = run(tmp_path / "runs", scene=str(scene))
    found = summary(folder)
    assert (status, found["verdict"]) == (0, "good"), said
    assert found["tip_error_last_rms_m"] < 1.2e-3


# A worker, as of a library for learned laws.
WORKER = """
import queue
import threading

asked, answers = queue.Queue(), queue.Queue()
threading.Thread(target=lambda: [answers.put(x) for x in iter(asked.get, None)], daemon=True).start()

class Spring"""


def test_a_law_with_threads_runs(scene, tmp_path):
    law = scene.with_name("my_law.py")
    text = law.read_text().replace("\nclass Spring(", f"{WORKER}(")
    asks = "        asked.put(dt)\n        answers.get(timeout=10)\n        q_d = "
    law.write_text(text.replace("        q_d = ", asks))
    status, said, _ = run(tmp_path / "runs", "duration_s=1", scene=str(scene))
    assert status == 0, said


def test_a_law_that_fails_on_the_way_is_named_with_file_and_line(scene, tmp_path):
    law = scene.with_name("my_law.py")
    text = law.read_text().replace("        q_d = ", "        1 / (state < 0.5)\n        q_d = ")
    law.write_text(text)
    line = 1 + text.splitlines().index("        1 / (state < 0.5)")
    status, _, folder = run(tmp_path / "runs", scene=str(scene))
    found = summary(folder)
    assert (status, found["verdict"]) == (1, "vented")
    named = f"law {law}:Spring: ZeroDivisionError: division by zero (my_law.py, line {line})"
    assert named in found["reason"]
    assert named in (folder / "log/controller.log").read_text()


def test_the_law_of_a_package_runs_by_its_name(monkeypatch, tmp_path):
    """Each law, and how well it follows: `test_law_packages.py`."""
    law = "energy_shaping"
    paths = [*paths_of(law, tmp_path / "installed"), os.environ.get("PYTHONPATH", "")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, paths)))
    changes = (f"controller.law={law}", "mode=lockstep", "platform=", "duration_s=0.5")
    status, said, folder = run(tmp_path / "runs", *changes)
    assert (status, summary(folder)["verdict"]) == (0, "good"), said

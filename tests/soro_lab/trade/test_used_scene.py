"""Scene files: what a run used can be run again."""

import yaml

from soro_core.config import find_config
from soro_lab.scene import load_scene


def test_the_scene_of_a_run_can_be_run_again(tmp_path):
    """With all its defaults written out, and what was changed on the command line."""
    names = [path.stem for path in find_config("track_circle", "scenes").parent.glob("*.yaml")]
    assert names
    for name in names:
        used = load_scene(name, {"controller.adapt": False, "twin.payload_kg": 0.01})
        path = tmp_path / f"{name}.yaml"
        path.write_text(yaml.safe_dump(used.to_dict(), sort_keys=False))
        assert load_scene(path) == used


def test_a_plant_that_follows_from_the_model_does_so_again(tmp_path):
    used = load_scene("track_circle", {"model": {"links": 2, "dt_s": 0.001}})
    path = tmp_path / "used.yaml"
    path.write_text(yaml.safe_dump(used.to_dict(), sort_keys=False))
    assert load_scene(path).twin_node() == used.twin_node()

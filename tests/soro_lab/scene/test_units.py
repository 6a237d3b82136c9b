"""Values with units in files and in --set: read in the unit of the key, or refused in one line."""

import importlib
import math
import pkgutil
import re
import subprocess
import sys

import pytest
import yaml

from soro_core import load_robot, robot_from_dict
from soro_core.config import Strict, parse, read_yaml
from soro_core.estimation.config import EstimatorConfig
from soro_core.files.units import as_number, unit_of
from soro_hardware.emulation.faults.fault_types import read_injection
from soro_lab.scene import load_scene
from tests.refused import refused


def at(thing, path):
    for name in path.split("."):
        thing = thing[int(name)] if name.isdigit() else getattr(thing, name)
    return thing


@pytest.mark.parametrize(
    ("key", "text", "path", "value"),
    [
        ("twin.payload_kg", "10g", "twin.payload_kg", 0.01),
        ("twin.payload_kg", "10 g", "twin.payload_kg", 0.01),
        ("controller.reference.mean_pressure_pa", "40kPa", "controller.reference.mean_pressure_pa", 40e3),
        ("limits.maximum_pa", "0.4bar", "limits.maximum_pa", 40e3),
        ("duration_s", "2min", "duration_s", 120.0),
        ("twin.step_s", "2ms", "twin.step_s", 2e-3),
        ("rate_hz", "0.2kHz", "rate_hz", 200.0),
        ("excite.motion.box_m", ["20mm"], "excite.motion.box_m.0", 0.02),
        ("excite.motion.bend_rad", "30deg", "excite.motion.bend_rad", math.radians(30)),
        ("controller.reference.curvature_per_m", "0.5 1/cm", "controller.reference.curvature_per_m", 50.0),
        ("controller.pressures.rise_pa_s", "150kPa/s", "controller.pressures.rise_pa_s", 150e3),
        ("controller.motion.speed_m_s", "40mm/s", "controller.motion.speed_m_s", 0.04),
        ("model", {"auto": True, "budget_us": "0.5ms"}, "model.budget_us", 500.0),
        (
            "twin.payload_changes",
            {"at_s": ["500ms"], "payload_kg": ["5g"]},
            "twin.payload_changes.at_s.0",
            0.5,
        ),
        (
            "twin.wrench",
            {"at_s": [1], "force_n": [["50mN", 0, 0]], "torque_nm": [["1Nmm", 0, 0]]},
            "twin.wrench.force_n.0",
            0.05,
        ),
        ("twin.wall", {"stiffness": "2 N/mm", "point": ["20mm", 0, 0]}, "twin.wall.stiffness", 2000.0),
        ("faults", [{"fault": "delay", "delay_s": "20ms", "at": "1.5s"}], "faults.0.value", 0.02),
    ],
)
def test_a_value_of_a_scene_is_read_in_the_unit_of_its_key(key, text, path, value):
    # 12 digits: of 0.1 g no factor leaves a trace.
    assert at(load_scene("track_circle", {key: text}), path) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("key", "text", "units"),
    [
        ("twin.payload_kg", "10mm", ("kg", "g")),
        ("duration_s", "20kPa", ("ms", "min")),
        ("limits.maximum_pa", "40kpa", ("kPa", "bar")),
        ("controller.reference.curvature_per_m", "5m", ("1/m",)),
        ("excite.motion.bend_rad", "30 degrees", ("deg",)),
    ],
)
def test_a_wrong_unit_is_refused_with_the_allowed_ones(key, text, units):
    with refused(key, text, units):
        load_scene("track_circle", {key: text})


@pytest.mark.parametrize(
    ("key", "text"), [("seed", "3s"), ("name", "5kg arm"), ("twin.stiffness_scale", "2m")]
)
def test_a_key_without_a_unit_takes_none(key, text):
    with refused(key, text):
        load_scene("track_circle", {key: text})


def test_a_robot_in_millimetres_and_grams_is_the_same_robot():
    file = load_robot("tue_three_bellow")
    data = read_yaml("config/robots/tue_three_bellow.yaml")
    link = data["links"][0]
    link |= {"length": f"{1e3 * file.links[0].length!r} mm", "radius": f"{1e2 * file.links[0].radius!r}cm"}
    link |= {"mass": f"{1e3 * file.links[0].mass!r} g"}
    found = robot_from_dict(data).links[0]
    assert (found.length, found.radius, found.mass) == pytest.approx(
        (file.links[0].length, file.links[0].radius, file.links[0].mass), rel=1e-12
    )
    with refused("links[0].length", "3kg", ("mm",)):
        robot_from_dict(data | {"links": [link | {"length": "3kg"}]})


def models(of=Strict):
    """Every section of a file, by its class; those of other tests are none."""
    own = {of} if of.__module__.startswith("soro_") else set()
    return own.union(*map(models, of.__subclasses__()))


def test_every_number_whose_description_states_a_unit_takes_it():
    for name in ("soro_core", "soro_hardware", "soro_lab", "soro_design", "soro_ros"):
        package = importlib.import_module(name)
        for module in pkgutil.walk_packages(package.__path__, f"{name}."):
            if not module.name.endswith("__main__"):
                importlib.import_module(module.name)
    refusing, taking = [], 0
    for model in models():
        for key, field in model.model_fields.items():
            # Of one unit: k_b has three, and so no text.
            units = re.findall(r"\[([^\[\],]*[a-zA-Z][^\[\],]*)\]", field.description or "")
            if "float" not in str(field.annotation) or len(units) != 1 or field.description.count("[") > 1:
                continue
            unit = units[0].replace(" gauge", "").replace("N/m2", "Pa")
            try:
                assert as_number(f"2 {unit}", unit_of(key, model.__name__)) == pytest.approx(2.0)
                taking += 1
            except ValueError:
                refusing.append(f"{model.__name__}.{key}: {unit}")
    assert not refusing
    assert taking > 50


@pytest.mark.parametrize(
    ("change", "path", "value"),
    [
        (
            {
                "sections": [
                    {"place": "0mm", "mass_per_m": "0.5kg/m"},
                    {"place": "64mm", "mass_per_m": "400 g/m"},
                ]
            },
            "links.0.sections.1",
            {"place": 0.064, "mass_per_m": 0.4},
        ),
        (
            {"calibration": {"curvature_offset": ["2 1/m", 0.0]}},
            "calibration",
            {"curvature_offset": (2.0, 0.0)},
        ),
        (
            {"contacts": {"planes": [{"point": ["1cm", 0, 0], "normal": [0, 0, 1], "stiffness": "1N/mm"}]}},
            "contacts.planes.0",
            {"stiffness": 1000.0, "point": (0.01, 0.0, 0.0)},
        ),
        (
            {"tip_constraint": {"point": [0, 0, "60mm"], "stiffness": "2 N/mm", "damping": "3 N s/m"}},
            "tip_constraint",
            {"stiffness": 2000.0, "damping": 3.0},
        ),
    ],
)
def test_a_key_whose_name_does_not_tell_its_unit_takes_it(change, path, value):
    data = read_yaml("config/robots/tue_three_bellow.yaml")
    if "sections" in change:
        data["links"][0] = {k: v for k, v in data["links"][0].items() if k != "mass"} | change
    else:
        data |= change
    found = at(robot_from_dict(data), path)
    assert {key: getattr(found, key) for key in value} == value


@pytest.mark.parametrize("key", ["curvature_acceleration_per_m", "curvature_disturbance_per_m"])
def test_an_acceleration_of_a_curvature_is_no_curvature(key):
    with refused(f"process.{key}", "5 1/m"):
        parse({"process": {key: "5 1/m"}}, EstimatorConfig, "test")


def test_a_fault_takes_units_too():
    assert read_injection("{fault: delay, delay_s: 20ms, duration_s: 1min}").duration_s == 60.0
    with refused("", names=("ms",)):
        read_injection("{fault: delay, delay_s: 20g}")


@pytest.mark.process
def test_the_command_reads_units_and_refuses_wrong_ones_in_one_line():
    def soro(change):
        command = [sys.executable, "-m", "soro_ros.cli", "gains", "track_circle", "--set", change]
        return subprocess.run(command, capture_output=True, text=True, check=False)

    assert yaml.safe_load(soro("controller.pressures.lag_s=60ms").stdout)["pressures"]["lag_s"] == 0.06
    done = soro("controller.pressures.lag_s=60mm")
    (line,) = done.stderr.splitlines()
    assert done.returncode == 2
    assert all(word in line for word in ("controller.pressures.lag_s", "'60mm'", "ms"))

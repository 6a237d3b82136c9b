"""Every wrong robot file makes one line with file, key, what was found and what is allowed."""

import copy

import pytest
import yaml

from soro_core.errors import ConfigError
from soro_core.robot import load_robot, robot_from_dict

GOOD = {
    "tip_mass": 0.01,
    "links": [
        {
            "length": 0.1,
            "radius": 0.02,
            "mass": 0.05,
            "k_e": [300.0, 100.0, 20.0],
            "k_b": [0.02, 0.01, 0.5],
            "damping": [0.1, 1e-6, 1e-6],
            "creep": [{"tau": 0.1, "stiffness": [1.0, 1e-3, 1e-3]}],
            "hysteresis": [{"stiffness": [1.0, 1e-3, 1e-3], "range": [0.1, 1.0, 1.0]}],
            "chambers": [{"angle_rad": 0.0, "area_m2": 1e-4, "offset_m": 0.01}],
        }
    ],
}
MATERIAL = {"youngs_modulus": 5e5, "shear_modulus": 1.7e5, "viscosity": 300.0}
REMOVED = object()

# (path of the key, new value, key named in the line, words in what was found, words in what is allowed)
BAD = [
    (("links",), REMOVED, "links", "nothing", "required"),
    (("links",), [], "links", "[]", "at least 1"),
    (("links",), 3, "links", "3", "tuple"),
    (("colour",), "red", "colour", "an unknown key", "links"),
    (("links", 0, "lenght"), 0.1, "links[0].lenght", "an unknown key", "length"),
    (("links", 0, "length"), REMOVED, "links[0].length", "nothing", "required"),
    (("links", 0, "length"), -0.1, "links[0].length", "-0.1", "greater than 0"),
    (("links", 0, "length"), "10 cm", "links[0].length", "10 cm", "number"),
    (("links", 0, "length"), True, "links[0].length", "True", "number"),
    (("links", 0, "length"), float("nan"), "links[0].length", "nan", "finite"),
    (("links", 0, "radius"), 0, "links[0].radius", "0", "greater than 0"),
    (("links", 0, "mass"), -1.0, "links[0].mass", "-1.0", "greater than or equal to 0"),
    (("links", 0, "mass"), 0.0, "links[0].mass", "0.0", "above 0"),
    (("links", 0, "mass"), REMOVED, "links[0].mass", "0.0", "mass [kg] or density"),
    (("links", 0, "density"), 1000.0, "links[0].mass", "0.05", "either mass or density"),
    (("links", 0, "k_e"), [300.0, 100.0], "links[0].k_e", "[300.0, 100.0]", "3 numbers"),
    (("links", 0, "k_e"), [100.0, 300.0, 20.0], "links[0].k_e", "[100.0, 300.0, 20.0]", "a1 > a2"),
    (("links", 0, "k_b"), [0.01, 0.01, 0.5], "links[0].k_b", "[0.01, 0.01, 0.5]", "a4 > a5"),
    (("links", 0, "k_b"), [0.02, float("inf"), 0.5], "links[0].k_b[1]", "inf", "finite"),
    (("links", 0, "k_b"), REMOVED, "links[0].k_b", "None", "three values, or a material"),
    (("links", 0, "material"), MATERIAL, "links[0].k_e", "[300.0", "either material, or k_e and k_b"),
    (("links", 0, "damping"), [0.1, 1e-6], "links[0].damping", "[0.1, 1e-06]", "3 values of 0 or more"),
    (("links", 0, "damping"), [0.1, -1e-6, 0], "links[0].damping", "-1e-06", "3 values of 0 or more"),
    (("links", 0, "creep", 0, "tau"), 0.0, "links[0].creep[0].tau", "0.0", "above 0"),
    (("links", 0, "creep", 0, "stiffness"), [1.0], "links[0].creep", "[1.0]", "stiffness with 3 values"),
    (("links", 0, "creep", 0, "rate"), 1.0, "links[0].creep[0].rate", "an unknown key", "tau, stiffness"),
    (
        ("links", 0, "hysteresis", 0, "range"),
        [0.1, 0.0, 1],
        "links[0].hysteresis[0].range",
        "[0.1",
        "above 0",
    ),
    (
        ("links", 0, "strains"),
        {"twist": {"basis": "constant"}},
        "links[0].strains",
        "twist",
        "torsion, bending_x",
    ),
    (
        ("links", 0, "strains"),
        {"torsion": {"basis": "constant"}},
        "links[0].k_e",
        "[300.0",
        "a material instead",
    ),
    (
        ("links", 0, "strains"),
        {"bending_x": {"basis": "legendre", "order": 2}},
        "links[0].strains.bending_x.basis",
        "legendre",
        "'constant'",
    ),
    (("links", 0, "chambers", 0, "angle_rad"), 90.0, "links[0].chambers[0].angle_rad", "90.0", "less than"),
    (
        ("links", 0, "chambers", 0, "offset_m"),
        REMOVED,
        "links[0].chambers[0].offset_m",
        "None",
        "area_m2 together",
    ),
    (("links", 0, "chambers", 0, "alpha_eps"), 1e-6, "links[0].chambers[0].alpha_kappa", "None", "together"),
    (
        ("links", 0, "chambers", 0),
        {"angle_rad": 0.0},
        "links[0].chambers[0].alpha_kappa",
        "None",
        "exactly one",
    ),
    (("tip_mass",), -0.01, "tip_mass", "-0.01", "greater than or equal to 0"),
    (("gravity",), [0.0, 9.81], "gravity", "[0.0, 9.81]", "3 numbers"),
    (("base_quaternion",), [0.0, 0.0, 0.0, 2.0], "base_quaternion", "2.0", "unit quaternion"),
    (("base_position",), [0.0, "up", 0.0], "base_position[1]", "up", "number"),
    (("bend_angle",), "bent", "bend_angle", "bent", "'deformed' or 'geometric'"),
    (("pressure_range_pa",), [9e4, 0.0], "pressure_range_pa", "[90000.0, 0.0]", "lowest < highest"),
    (
        ("calibration",),
        {"frame_rotation": 0.1},
        "calibration.frame_rotation",
        "an unknown key",
        "frame_rotation_rad",
    ),
    (("refinement",), 2, "refinement", "2", "a divisor of the number of links (1)"),
]


def changed(path, value):
    data = copy.deepcopy(GOOD)
    place = data
    for key in path[:-1]:
        place = place[key]
    if value is REMOVED:
        del place[path[-1]]
    else:
        place[path[-1]] = value
    return data


def test_the_good_robot_is_good():
    assert robot_from_dict(GOOD).n_q == 3


@pytest.mark.parametrize(("path", "value", "key", "got", "allowed"), BAD)
def test_one_line_names_file_key_value_and_what_is_allowed(tmp_path, path, value, key, got, allowed):
    file = tmp_path / "wrong.yaml"
    file.write_text(yaml.safe_dump(changed(path, value)))
    with pytest.raises(ConfigError) as error:
        load_robot(file)
    line = str(error.value)
    assert line.startswith(f"{file}: {key}: got ")
    found, _, wanted = line.partition("; allowed: ")
    assert got in found
    assert allowed in wanted
    assert "\n" not in line


@pytest.mark.parametrize(
    ("text", "got", "allowed"),
    [
        (None, "no such file", "an existing YAML file"),
        ("", "None", "a mapping of keys to values"),
        ("- 1\n- 2\n", "[1, 2]", "a mapping"),
        ("links: [", "expected", "valid YAML"),
        ("tip_mass: 0\ntip_mass: 1\n", "stands twice", "valid YAML"),
    ],
)
def test_files_that_are_no_robot(tmp_path, text, got, allowed):
    file = tmp_path / "wrong.yaml"
    if text is not None:
        file.write_text(text)
    with pytest.raises(ConfigError) as error:
        load_robot(file)
    assert str(error.value).startswith(f"{file}: got ")
    assert got in str(error.value)
    assert allowed in str(error.value)


def test_an_unknown_name_lists_the_shipped_robots():
    with pytest.raises(ConfigError, match="six_link"):
        load_robot("no_such_robot")


def test_material_with_wrong_value():
    data = changed(("links", 0, "material"), {**MATERIAL, "viscosity": -1.0})
    del data["links"][0]["k_e"], data["links"][0]["k_b"]
    with pytest.raises(
        ConfigError, match=r"links\[0\]\.material\.viscosity: got -1\.0; allowed: input should be greater"
    ):
        robot_from_dict(data)

"""Every wrong robot file makes one line with file, key, what was found and what is allowed."""

import copy

import numpy as np
import pytest
import yaml

from soro_core.errors import ConfigError
from soro_core.robot import load_robot, robot_from_dict
from tests.refused import refused

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
CHAMBER = ("links", 0, "chambers", 0)
SQUARE = [[1.0, -1.0], [1.0, -0.4], [1.0, 0.4], [1.0, 1.0]]

# (path of the key, new value, key named in the line, words in what was found, words in what is allowed)
BAD = [
    (("links",), REMOVED, "links", "nothing", "required"),
    ((*CHAMBER, "dead_band_pa"), -1.0, "links[0].chambers[0].dead_band_pa", "-1", "0"),
    ((*CHAMBER, "area_saturation"), 1.0, "links[0].chambers[0].area_saturation", "1", "0.99"),
    ((*CHAMBER, "area_saturation"), 0.5, "links[0].chambers[0].area_saturation", "0.5", "area_slope"),
    (("links",), [], "links", "[]", "at least 1"),
    (("links",), 3, "links", "3", "a list"),
    (("colour",), "red", "colour", "an unknown key", "links"),
    (("links", 0, "lenght"), 0.1, "links[0].lenght", "an unknown key", "length"),
    (("links", 0, "length"), REMOVED, "links[0].length", "nothing", "required"),
    (("links", 0, "length"), -0.1, "links[0].length", "-0.1", "greater than 0"),
    (("links", 0, "length"), "10 kg", "links[0].length", "10 kg", "cm"),
    (("links", 0, "length"), True, "links[0].length", "True", "number"),
    (("links", 0, "length"), float("nan"), "links[0].length", "nan", "finite"),
    (("links", 0, "radius"), 0, "links[0].radius", "0", "greater than 0"),
    (("links", 0, "radius"), REMOVED, "links[0].radius", "0.0", "in each of the sections"),
    (("links", 0, "rest_curvature_per_m"), [5.0], "links[0].rest_curvature_per_m", "[5.0]", "2 numbers"),
    (("links", 0, "rest_torsion_per_m"), float("nan"), "links[0].rest_torsion_per_m", "nan", "finite"),
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
    (("links", 0, "least_elongation"), -0.995, "links[0].least_elongation", "-0.995", "-0.99"),
    (("links", 0, "least_elongation"), 0.0, "links[0].least_elongation", "0.0", "less than 0"),
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
    (("links", 0, "chambers", 0, "angle_rad"), 90.0, "links[0].chambers[0].angle_rad", "90.0", "less than"),
    (
        ("links", 0, "chambers", 0, "offset_m"),
        REMOVED,
        "links[0].chambers[0].offset_m",
        "None",
        "area_m2 or muscle together",
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
    (("base_quaternion",), [0.0, 0.0, 0.0, 0.9989], "base_quaternion", "0.9989", "here 0.9989"),
    (("base_quaternion",), [0.0, 0.0, 0.0, 0.0], "base_quaternion", "0.0", "here 0"),
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


# (keys of the field of bending_x, key named in the line, words in what was found, words in what is allowed)
BAD_FIELDS = [
    ("cubic", "", "cubic", "a mapping of keys to values"),
    ({"basis": "fourier", "order": 2}, "basis", "fourier", "'constant', 'legendre', 'chebyshev' or 'pod'"),
    ({"basis": 1}, "basis", "1", "'constant', 'legendre', 'chebyshev' or 'pod'"),
    ({"basis": "legendre"}, "order", "None", "a polynomial degree from 0 to 12 for basis legendre"),
    ({"basis": "chebyshev"}, "order", "None", "a polynomial degree from 0 to 12 for basis chebyshev"),
    ({"basis": "constant", "order": 0}, "order", "0", "no order with basis constant"),
    ({"order": 2}, "order", "2", "no order with basis constant"),
    ({"basis": "legendre", "order": -1}, "order", "-1", "greater than or equal to 0"),
    ({"basis": "legendre", "order": 13}, "order", "13", "less than or equal to 12"),
    ({"basis": "legendre", "order": 2.5}, "order", "2.5", "integer"),
    ({"basis": "legendre", "order": True}, "order", "True", "integer"),
    ({"basis": "legendre", "order": float("nan")}, "order", "nan", "integer"),
    ({"basis": "legendre", "order": 2, "degree": 2}, "degree", "an unknown key", "basis, order, modes"),
    ({"basis": "legendre", "order": 2, "modes": 2}, "modes", "2", "no modes with basis legendre"),
    ({"basis": "constant", "samples": SQUARE}, "samples", "[[1.0", "no samples with basis constant"),
    ({"basis": "chebyshev", "order": 1, "file": "m.npy"}, "file", "m.npy", "no file with basis chebyshev"),
    ({"basis": "pod"}, "file", "None", "samples of the modes, or a file"),
    ({"basis": "pod", "samples": SQUARE, "order": 1}, "order", "1", "no order with basis pod"),
    ({"basis": "pod", "samples": SQUARE, "modes": 0}, "modes", "0", "greater than or equal to 1"),
    ({"basis": "pod", "samples": SQUARE, "modes": 3}, "samples", "[[1.0", "as many modes as are used (3)"),
    ({"basis": "pod", "samples": []}, "samples", "[]", "n_samples >= 4"),
    ({"basis": "pod", "samples": [1.0, 1.0, 1.0, 1.0]}, "samples[0]", "1.0", "a list"),
    ({"basis": "pod", "samples": SQUARE[:3]}, "samples", "[[1.0", "n_samples >= 4"),
    ({"basis": "pod", "samples": [*SQUARE, [1.0]]}, "samples", "[1.0]", "(n_samples, n_modes)"),
    ({"basis": "pod", "samples": [[]] * 4}, "samples", "[[]", "n_modes >= 1"),
    ({"basis": "pod", "samples": [[1.0, 2.0, 3.0, 4.0, 5.0]] * 4}, "samples", "[[1.0", ">= n_modes"),
    ({"basis": "pod", "samples": [*SQUARE, [1.0, float("nan")]]}, "samples[4][1]", "nan", "finite"),
    ({"basis": "pod", "samples": [*SQUARE, [float("inf"), 1.0]]}, "samples[4][0]", "inf", "finite"),
    ({"basis": "pod", "samples": [*SQUARE, ["x", 1.0]]}, "samples[4][0]", "x", "number"),
    ({"basis": "pod", "samples": [[1.0, 2.0]] * 4}, "samples", "[[1.0", "linearly independent"),
    ({"basis": "pod", "samples": [[1.0, 0.0]] * 4}, "samples", "[[1.0", "none of them zero"),
    ({"basis": "pod", "file": "modes.txt"}, "file", "modes.txt", ".npy, .npz, .csv"),
    ({"basis": "pod", "file": "none.npy"}, "file", "none.npy: no such file", "an existing file"),
    ({"basis": "pod", "file": 7}, "file", "7", "string"),
    ({"basis": "pod", "file": "text.npy"}, "file", "text.npy: ", "one array of numbers"),
    ({"basis": "pod", "file": "text.npz"}, "file", "text.npz: ", "one array of numbers"),
    ({"basis": "pod", "file": "text.csv"}, "file", "text.csv: ", "one array of numbers"),
    ({"basis": "pod", "file": "empty.csv"}, "file", "empty.csv: no row", "one array of numbers"),
    ({"basis": "pod", "file": "two.npz"}, "file", "two.npz: 2 arrays", "one array of numbers"),
    ({"basis": "pod", "file": "flat.npy"}, "file", "flat.npy: shape (9,)", "(n_samples, n_modes)"),
    ({"basis": "pod", "file": "wide.csv"}, "file", "wide.csv: shape (2, 4)", "n_samples >= 4"),
    ({"basis": "pod", "file": "complex.npy"}, "file", "values of type complex128", "real numbers"),
    ({"basis": "pod", "file": "nan.npy"}, "file", "nan.npy: nan in row 2", "finite numbers"),
    ({"basis": "pod", "file": "good.npy", "modes": 3}, "file", "good.npy: shape (4, 2)", "are used (3)"),
    ({"basis": "pod", "file": "alike.csv"}, "file", "alike.csv: shape (5, 2)", "linearly independent"),
]


@pytest.fixture
def folder(tmp_path):
    """Folder of a robot file with array files, one of them good."""
    np.save(tmp_path / "good.npy", SQUARE)
    for name in ("text.npy", "text.npz", "text.csv"):
        (tmp_path / name).write_text("no, numbers\n")
    (tmp_path / "empty.csv").write_text("")
    np.savez(tmp_path / "two.npz", a=SQUARE, b=SQUARE)
    np.save(tmp_path / "flat.npy", np.ones(9))
    np.savetxt(tmp_path / "wide.csv", np.transpose(SQUARE), delimiter=",")
    np.save(tmp_path / "complex.npy", np.array(SQUARE) * 1j)
    np.save(tmp_path / "nan.npy", [*SQUARE[:2], [np.nan, 0.0], *SQUARE[2:]])
    np.savetxt(tmp_path / "alike.csv", [[k, 3 * k] for k in range(5)], delimiter=",")
    return tmp_path


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


@pytest.mark.parametrize(("field", "key", "got", "allowed"), BAD_FIELDS)
def test_one_line_for_a_wrong_strain_field(folder, field, key, got, allowed):
    data = changed(("links", 0, "strains"), {"bending_x": field})
    for name in ("damping", "creep", "hysteresis"):
        del data["links"][0][name]
    file = folder / "wrong.yaml"
    file.write_text(yaml.safe_dump(data))
    with pytest.raises(ConfigError) as error:
        load_robot(file)
    line = str(error.value)
    assert line.startswith(f"{file}: links[0].strains.bending_x{'.' if key else ''}{key}: got ")
    found, _, wanted = line.partition("; allowed: ")
    assert got in found
    assert allowed in wanted
    assert "\n" not in line


def test_the_good_file_of_modes_is_good(folder):
    data = changed(("links", 0, "strains"), {"bending_x": {"basis": "pod", "file": "good.npy"}})
    for name in ("damping", "creep", "hysteresis"):
        del data["links"][0][name]
    (folder / "right.yaml").write_text(yaml.safe_dump(data))
    assert load_robot(folder / "right.yaml").n_q == 2


@pytest.mark.parametrize(
    ("key", "value", "got", "allowed"),
    [
        ("damping", [0.1, 1e-6, 1e-6], "[0.1", "4 values of 0 or more, one for each of "),
        ("creep", [{"tau": 0.1, "stiffness": [1.0]}], "[1.0]", "stiffness with 4 values, one for each of "),
        (
            "creep",
            [{"tau": [1.0, 1.0], "stiffness": [1.0] * 4}],
            "[1.0",
            "tau with 4 values, one for each of ",
        ),
        ("hysteresis", [{"stiffness": [1.0] * 4, "range": [1.0] * 3}], "'range'", "range with 4 values, "),
    ],
)
def test_losses_have_one_value_for_each_coordinate(key, value, got, allowed):
    data = copy.deepcopy(GOOD)
    link = data["links"][0]
    link["strains"] = {"bending_x": {"basis": "chebyshev", "order": 2}, "elongation": {}}
    for name in ("damping", "creep", "hysteresis"):
        del link[name]
    link[key] = value
    with pytest.raises(ConfigError) as error:
        robot_from_dict(data)
    line = str(error.value)
    assert line.startswith(f"robot: links[0].{key}: got ")
    assert got in line
    assert allowed in line
    assert line.endswith("one for each of bending_x_0, bending_x_1, bending_x_2, elongation")


@pytest.mark.parametrize(
    ("text", "got", "allowed"),
    [
        (None, "no such file", "an existing YAML file"),
        ("", "None", "a mapping of keys to values"),
        ("- 1\n- 2\n", "[1, 2]", "a mapping"),
        ("links: [", "expected", "valid YAML"),
        ("tip_mass: 0\ntip_mass: 1\n", "occurs twice", "valid YAML"),
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
    with refused("", names=("six_link",)):
        load_robot("no_such_robot")


def test_material_with_wrong_value():
    data = changed(("links", 0, "material"), {**MATERIAL, "viscosity": -1.0})
    del data["links"][0]["k_e"], data["links"][0]["k_b"]
    with refused("links[0].material.viscosity", -1.0):
        robot_from_dict(data)


BOTH = [{"place": 0.0, "radius": 0.02}, {"place": 0.1, "radius": 0.01}]
# (keys of the link, key named in the line, words in what was found, words in what is allowed)
BAD_SECTIONS = [
    (
        {"sections": BOTH, "radius": 0.015},
        "radius",
        "0.015",
        "either one radius, or that of each of the sections",
    ),
    ({"sections": [BOTH[0], {**BOTH[1], "radius": 0.0}]}, "sections[1].radius", "0.0", "greater than 0"),
    ({"sections": [BOTH[0], {**BOTH[1], "radius": -1.0}]}, "sections[1].radius", "-1.0", "greater than 0"),
    ({"sections": [BOTH[0], {"radius": 0.01}]}, "sections[1].place", "nothing", "required"),
    ({"sections": BOTH[:1]}, "sections", "[", "two or more places that grow from 0 to the length"),
    ({"sections": BOTH[::-1]}, "sections", "[", "grow from 0 to the length of the link, 0.1 m"),
    ({"sections": [BOTH[0], BOTH[0], BOTH[1]]}, "sections", "[", "grow from 0"),
    ({"sections": [BOTH[0], {**BOTH[1], "place": 0.09}]}, "sections", "[", "the length of the link, 0.1 m"),
    (
        {"sections": [BOTH[0], {**BOTH[1], "stiffness": 2.0}]},
        "sections",
        "[",
        "the same ones in each of them",
    ),
    ({"sections": [{"place": 0.0}, {"place": 0.1}]}, "sections", "[", "values besides the place"),
    ({"sections": [{**row, "colour": 1} for row in BOTH]}, "sections[0].colour", "unknown key", "stiffness"),
    ({"sections": [{"place": s, "mass_per_m": 1.0} for s in (0.0, 0.1)]}, "mass", "0.05", "mass_per_m"),
    (
        {
            "sections": [{"place": s, "rest_torsion_per_m": 1.0} for s in (0.0, 0.1)],
            "rest_torsion_per_m": 1.0,
        },
        "rest_torsion_per_m",
        "1.0",
        "either of the link, or of each of the sections",
    ),
]


@pytest.mark.parametrize(("keys", "key", "got", "allowed"), BAD_SECTIONS)
def test_a_wrong_section_makes_one_line(tmp_path, keys, key, got, allowed):
    data = copy.deepcopy(GOOD)
    data["links"][0] |= keys
    with pytest.raises(ConfigError) as error:
        robot_from_dict(data)
    found, _, wanted = str(error.value).partition("; allowed: ")
    assert found.startswith(f"robot: links[0].{key}: got ")
    assert got in found
    assert allowed in wanted
    assert "\n" not in found + wanted


def test_density_and_mass_per_m_are_not_both_given():
    link = {**GOOD["links"][0], "density": 1000.0, "mass": 0.0}
    link["sections"] = [{"place": s, "mass_per_m": 1.0} for s in (0.0, 0.1)]
    with refused("links[0].mass", 0.0, ("density", "mass_per_m")):
        robot_from_dict({"links": [link]})

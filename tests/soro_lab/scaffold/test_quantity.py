"""Numbers with units on a command line."""

import math

import pytest

from soro_lab.scaffold import quantity
from soro_lab.scaffold.options import Options, read_links, read_one, read_range, read_sensors
from tests.refused import refused


@pytest.mark.parametrize(
    ("kind", "text", "values"),
    [
        (quantity.LENGTH, "0.08", (0.08,)),
        (quantity.LENGTH, "80mm", (0.08,)),
        (quantity.LENGTH, "8 cm, 60 mm", (0.08, 0.06)),
        (quantity.LENGTH, "80,60mm", (0.08, 0.06)),  # the unit of the last one
        (quantity.MASS, "30g", (0.03,)),
        (quantity.PRESSURE, "-20,90kPa", (-20e3, 90e3)),
        (quantity.PRESSURE, "0,9e4", (0.0, 90e3)),
        (quantity.PRESSURE, "0,0.9bar", (0.0, 90e3)),
        (quantity.MODULUS, "0.3MPa", (300e3,)),
        (quantity.AREA, "40mm2", (40e-6,)),
        (quantity.DENSITY, "1070", (1070.0,)),
        (quantity.DENSITY, "1.07g/cm3", (1070.0,)),
        (quantity.BENDING, "5Nmm/rad", (5e-3,)),
        (quantity.ANGLE, "0,120", (0.0, 2.0 * math.pi / 3.0)),
        (quantity.ANGLE, "1.5rad", (1.5,)),
    ],
)
def test_numbers_are_read_with_their_units(kind, text, values):
    assert kind.read(text, "--x") == pytest.approx(values, rel=1e-9)


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        (quantity.LENGTH, "80"),  # 80 m: millimetres are meant
        (quantity.LENGTH, "80ft"),
        (quantity.LENGTH, "80 mm 60 mm"),
        (quantity.LENGTH, "80mm,"),
        (quantity.LENGTH, "-80mm"),
        (quantity.LENGTH, "nan"),
        (quantity.LENGTH, "1e400"),
        (quantity.MASS, "0"),
        (quantity.PLACE, "1.5"),
        (quantity.PLACE, "1m"),
        (quantity.DENSITY, "1.07"),  # g/cm3 are meant
    ],
)
def test_other_texts_are_refused_with_the_option(kind, text):
    with refused("--x", text, (kind.example,)):
        kind.read(text, "--x")


def test_a_value_is_for_all_links_or_one_each():
    one, two = read_links(Options("arm", length="80mm,60mm", mass="30g", chambers="3,2"))
    assert (one.length, two.length, one.mass, two.mass) == (0.08, 0.06, 0.03, 0.03)
    assert (one.count, two.count) == (3, 2)
    with refused("--length", names=("3",)):
        read_links(Options("arm", links=3, length="80mm,60mm"))
    with refused("--mass"):
        read_links(Options("arm", length="1m,1m,1m", mass="30g,20g"))


def test_angles_are_degrees_with_a_slash_between_links():
    one, two = read_links(Options("arm", angles="0,120,240/90,270", length="80mm"))
    assert one.angles == pytest.approx((0.0, 2 * math.pi / 3, 4 * math.pi / 3))
    assert two.angles == pytest.approx((math.pi / 2, 3 * math.pi / 2))
    assert (one.count, two.count) == (3, 2)


@pytest.mark.parametrize(
    ("angles", "chambers"),
    [
        ("0,2.094,4.189", ""),  # radians are meant
        ("0,120", "3"),
        ("0,120,240", "2"),
        ("0,x", ""),
    ],
)
def test_angles_that_do_not_fit_are_refused(angles, chambers):
    with refused("--angles"):
        read_links(Options("arm", angles=angles, chambers=chambers))


@pytest.mark.parametrize("chambers", ["0", "2.5", "-1", "13", "three"])
def test_numbers_of_chambers_that_no_link_has_are_refused(chambers):
    with refused("--chambers"):
        read_links(Options("arm", chambers=chambers))


@pytest.mark.parametrize("links", [0, -1, 13])
def test_numbers_of_links_that_no_arm_has_are_refused(links):
    with refused("--links", links):
        read_links(Options("arm", links=links))


def test_a_range_of_pressures_has_a_lowest_and_a_highest():
    assert read_range("") is None
    assert read_range("90kPa") == (0.0, 90e3)
    assert read_range("10,90kPa") == (10e3, 90e3)
    for text in ("90,0kPa", "0,90", "1,2,3kPa", "-20kPa", "0,2MPa"):
        with refused("--pressure-range", text):
            read_range(text)


def test_an_option_of_the_whole_arm_has_one_value():
    assert read_one(quantity.LOAD, "", "--payload") is None
    assert read_one(quantity.LOAD, "20g", "--payload") == 0.02
    with refused("--payload", "20g,10g"):
        read_one(quantity.LOAD, "20g,10g", "--payload")


@pytest.mark.parametrize(
    ("sensors", "places", "links", "poses", "imus"),
    [
        ("pose", "", 1, (1.0,), ()),
        ("poses", "", 1, (0.5, 1.0), ()),
        ("poses", "", 3, (0.3333, 0.6667, 1.0), ()),
        ("poses", "0.3,1", 3, (0.3, 1.0), ()),
        ("imu", "", 2, (), (1.0,)),
        ("poses,imu", "", 2, (0.5, 1.0), (1.0,)),
    ],
)
def test_sensors_have_places(sensors, places, links, poses, imus):
    assert read_sensors(sensors, places, links) == (poses, imus)


@pytest.mark.parametrize("sensors", ["", "camera", "pose,poses", "pose,pose"])
def test_other_sensors_are_refused(sensors):
    with refused("--sensors", sensors, ("pose", "imu")):
        read_sensors(sensors, "", 1)


def test_a_sensor_at_the_base_is_refused():
    with refused("--sensor-places", "0,1"):
        read_sensors("poses", "0,1", 1)

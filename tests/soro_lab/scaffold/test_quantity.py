"""Numbers with units on a command line."""

import pytest

from soro_lab.scaffold import quantity
from soro_lab.scaffold.options import ScaffoldOptions, read_links, read_range
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
        (quantity.BENDING, "5Nmm/rad", (5e-3,)),
    ],
)
def test_numbers_are_read_with_their_units(kind, text, values):
    assert kind.read(text, "soro new", "--x") == pytest.approx(values, rel=1e-9)


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
    ],
)
def test_other_texts_are_refused_with_the_option(kind, text):
    with refused("--x", text, (kind.example,)):
        kind.read(text, "soro new", "--x")


def test_a_value_is_for_all_links_or_one_each():
    one, two = read_links(ScaffoldOptions("arm", length="80mm,60mm", mass="30g", chambers="3,2"))
    assert (one.length, two.length, one.mass, two.mass) == (0.08, 0.06, 0.03, 0.03)
    assert (one.count, two.count) == (3, 2)
    with refused("--length", names=("3",)):
        read_links(ScaffoldOptions("arm", links=3, length="80mm,60mm"))
    with refused("--mass"):
        read_links(ScaffoldOptions("arm", length="1m,1m,1m", mass="30g,20g"))


@pytest.mark.parametrize("chambers", ["0", "2.5", "-1", "13", "three"])
def test_numbers_of_chambers_that_no_link_has_are_refused(chambers):
    with refused("--chambers"):
        read_links(ScaffoldOptions("arm", chambers=chambers))


@pytest.mark.parametrize("links", [0, -1, 13])
def test_numbers_of_links_that_no_arm_has_are_refused(links):
    with refused("--links", links):
        read_links(ScaffoldOptions("arm", links=links))


def test_a_range_of_pressures_has_a_lowest_and_a_highest():
    assert read_range("") is None
    assert read_range("90kPa") == (0.0, 90e3)
    assert read_range("10,90kPa") == (10e3, 90e3)
    for text in ("90,0kPa", "0,90", "1,2,3kPa", "-20kPa", "0,2MPa"):
        with refused("--pressure-range", text):
            read_range(text)

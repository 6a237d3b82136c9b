"""What the tests of a twin with air share."""

import pytest

from soro_core import load_robot


@pytest.fixture(scope="session")
def robot_with_tubes():
    """The three-bellow arm with tubes and chambers of 30 ml."""
    one = load_robot("tue_three_bellow")
    links = [link.model_dump(exclude_unset=True) for link in one.links]
    for link in links:
        link["chambers"] = [{**chamber, "volume_m3": 30e-6} for chamber in link["chambers"]]
    return one.replace(links=links)

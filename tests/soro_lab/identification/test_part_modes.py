"""Modes of the strain: what they keep, and the file that a robot loads."""

import numpy as np
import pytest
import yaml
from made_rod import KNOWN, VALUES, Z, made_data, poses_of
from scipy.linalg import expm

from soro_core.robot.basis import shape_values
from soro_core.robot.load import load_robot, robot_from_dict
from soro_core.rotation import skew
from soro_design.parts.sweeps import Backbone
from soro_design.robot_of_part.link import robot_keys
from soro_design.robot_of_part.modes import kept, mode_file, modes, samples_of, strain_keys, tip

DATA = made_data(n=1)
MIDDLE = 0.5 * (Z[1:] + Z[:-1])


def varying(a, b):
    """A state whose curvature is a + b z (towards x) and whose elongation is a share of it."""
    strains = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (16, 1))
    strains[:, 1] = a + b * MIDDLE
    strains[:, 5] += 0.01 * (a + b * MIDDLE)
    return Backbone("made", 1.0, np.zeros(3), np.zeros(3), False, poses_of(strains))


STATES = [varying(a, b) for a, b in ((4.0, 0.0), (2.0, 60.0), (-1.0, 30.0), (5.0, -20.0))]


def test_two_modes_keep_a_family_of_two_shapes_and_one_or_a_constant_do_not():
    found = modes(DATA, STATES, 2)
    both = kept(DATA, STATES, found, 2)
    assert both.strain < 1e-9
    assert both.tip_most < 1e-9
    one, constant = kept(DATA, STATES, found, 1), kept(DATA, STATES, None)
    assert 0.1 < one.strain < constant.strain
    assert 1e-3 < one.tip_mean <= one.tip_most < constant.tip_most
    # Of mean square 1, and at right angles.
    weight = np.diff(Z) / (Z[-1] - Z[0])
    for shapes in (found.elongation, found.bending):
        np.testing.assert_allclose((shapes.T * weight) @ shapes, np.eye(2), atol=1e-12)


def test_a_constant_keeps_uniform_strains():
    assert kept(DATA, DATA.uneven, None).strain < 1e-9


def test_the_tip_is_that_of_exponentials():
    twist = np.zeros((4, 4))
    twist[:3, :3], twist[2, 3] = skew(np.array([-3.0, 8.0, 0.0])), 1.1
    strains = np.tile([0.1, 8.0, 3.0], (5, 1))
    assert tip(strains, np.full(5, 0.02)) == pytest.approx(expm(0.1 * twist)[:3, 3], abs=1e-15)


def test_a_robot_file_loads_the_modes(tmp_path):
    found = modes(DATA, STATES, 2)
    samples = samples_of(DATA, found)
    middle = [np.interp(0.04, MIDDLE, shape) for shape in found.bending.T]
    np.testing.assert_allclose(samples["bending"][30], middle, atol=1e-12)
    out = tmp_path / "made.yaml"
    for name, array in samples.items():
        np.save(mode_file(out, name), array)
    keys = robot_keys(KNOWN, VALUES, strain_keys(samples, out))
    # The order of strains is that of coordinates, and so of their damping.
    out.write_text(yaml.safe_dump(keys, sort_keys=False), encoding="utf-8")
    robot = load_robot(out)
    assert robot.coordinate_names[:2] == ("link0/elongation_0", "link0/elongation_1")
    assert robot.n_q == 6
    shown = shape_values(robot.links[0], np.linspace(0.0, 0.08, 61))
    np.testing.assert_allclose(shown[:2].T, samples["elongation"], atol=1e-12)
    np.testing.assert_allclose(shown[2:4].T, samples["bending"], atol=1e-12)
    inline = robot_from_dict(robot_keys(KNOWN, VALUES, strain_keys(samples)))
    assert inline.links[0].strains["bending_x"].samples == robot.links[0].strains["bending_x"].samples

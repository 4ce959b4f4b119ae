"""Bearing and aspect: as printed, and with their sense kept."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from assoc.methods.topology import (
    associate_by_topology,
    signed_angles,
    signed_topology_cost,
    topology_angles,
    topology_cost,
)

angles = st.floats(-3.1, 3.1)


@pytest.mark.parametrize(
    ("offset", "heading", "alpha", "beta"),
    [
        ((0.0, 5.0), 0.0, 0.0, 0.0),  # ahead, driving away
        ((5.0, 0.0), 0.0, np.pi / 2, np.pi / 2),  # to the right, crossing
        ((-5.0, 0.0), 0.0, np.pi / 2, np.pi / 2),  # to the left: the same, unsigned
        ((0.0, -5.0), 0.0, np.pi, np.pi),  # behind, coming
        ((0.0, 0.0), 0.0, np.pi / 2, np.pi / 2),  # straight below: no bearing
    ],
)
def test_angles_as_printed(offset, heading, alpha, beta):
    np.testing.assert_allclose(topology_angles(np.array([offset]), np.array([heading])), [[alpha, beta]], atol=1e-6)


def test_signed_angles_tell_left_from_right():
    found = signed_angles(np.array([[5.0, 0.0], [-5.0, 0.0]]), np.zeros(2))
    np.testing.assert_allclose(found, [[np.pi / 2, -np.pi / 2], [-np.pi / 2, np.pi / 2]])


@given(bearing=angles, heading=angles, reference=angles)
def test_unsigned_is_the_size_of_signed(bearing, heading, reference):
    offset = 7.0 * np.array([[np.sin(bearing), np.cos(bearing)]])
    signed = signed_angles(offset, np.array([heading]), reference)
    unsigned = topology_angles(offset, np.array([heading]), reference)
    np.testing.assert_allclose(unsigned, np.abs(signed), atol=1e-5)


@given(turn=angles)
def test_costs_do_not_change_when_the_world_turns(turn):
    rng = np.random.default_rng(3)
    offset, heading = rng.normal(0, 10, (5, 2)), rng.uniform(-3, 3, 5)
    c, s = np.cos(turn), np.sin(turn)
    # clockwise
    turned = offset @ np.array([[c, -s], [s, c]])
    image = signed_angles(offset, heading)
    world = signed_angles(turned, heading + turn, turn)
    np.testing.assert_allclose(signed_topology_cost(image, world), signed_topology_cost(image, image), atol=1e-6)


def test_association_follows_a_permutation_and_leaves_the_surplus():
    rng = np.random.default_rng(1)
    offset, heading = rng.normal(0, 10, (4, 2)), rng.uniform(-3, 3, 4)
    order = np.array([2, 0, 3, 1])
    world = topology_angles(offset, heading)
    cost = topology_cost(world[order], world)
    np.testing.assert_array_equal(associate_by_topology(cost), order)
    assert np.sum(associate_by_topology(cost[:, :2]) == -1) == 2


def test_unknown_heading_counts_as_agreement():
    image = topology_angles(np.array([[0.0, 5.0]]), np.array([np.nan]))
    world = topology_angles(np.array([[0.0, 9.0]]), np.array([2.0]))
    assert topology_cost(image, world)[0, 0] == pytest.approx(0.0, abs=1e-7)


@pytest.mark.parametrize("shape", [(0, 0), (0, 3), (3, 0)])
def test_nothing_to_associate(shape):
    answer = associate_by_topology(np.empty(shape))
    assert answer.tolist() == [-1] * shape[0]

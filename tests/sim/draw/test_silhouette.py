"""Outlines of bodies and robots: distances are those of the shapes themselves."""

import numpy as np
import pytest

from roadmap.geometry.gaps import moved_rods
from roadmap.kinematics.forward import body_frames, sphere_centers
from sim.draw.silhouette import Silhouette, robot_silhouette

ROD = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.1]


def test_a_capsule_is_seen_as_long_and_thick_as_it_is():
    solid = Silhouette([ROD])
    x, z = np.array([0.5, 1.3, 0.5, 0.0]), np.array([0.3, 0.0, 0.0, 0.1])
    np.testing.assert_allclose(
        solid.distance((0, 2), x, z), [0.2, 0.2, -0.1, 0.0], atol=1e-12
    )
    # end-on it is a disk
    np.testing.assert_allclose(
        solid.distance((1, 2), x, z)[1:3], [1.2, 0.4], atol=1e-12
    )


def test_a_box_is_seen_as_its_hull_and_parts_are_joined():
    corners = np.array(np.meshgrid([0, 1], [0, 2], [0, 3])).reshape(3, -1).T
    solid = Silhouette([ROD], [corners.astype(float)])
    at = solid.distance((1, 2), np.array([1.0, 2.5, -0.05]), np.array([1.0, 1.0, 0.0]))
    np.testing.assert_allclose(at, [-1.0, 0.5, -0.05], atol=1e-12)


def test_a_flat_part_has_no_outline_edge_on():
    flat = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    x = np.zeros(3)
    assert np.isinf(Silhouette(polytopes=[flat]).distance((0, 2), x, x)).all()


@pytest.mark.parametrize("plane", [(0, 2), (0, 1)])
def test_a_robots_outline_holds_its_cover(crane, plane):
    """Every sphere's centre is on or in its link, so it is inside the outline."""
    q, T = np.array([0.7, -0.4]), np.eye(4)
    T[:3, 3] = [0.2, -0.1, 0.75]
    solid = robot_silhouette(crane, q, T)
    centres = sphere_centers(crane, q) + T[:3, 3]
    inside = solid.distance(plane, *centres[:, list(plane)].T)
    assert (inside < 1e-6).all()
    assert len(body_frames(crane, q)) == 3


def test_moved_capsules_are_those_of_the_other_frame():
    T = np.array([[0.0, -1, 0, 1], [1, 0, 0, 0], [0, 0, 1, 2], [0, 0, 0, 1]])
    moved = moved_rods(np.array([ROD]), T)
    np.testing.assert_allclose(moved, [[1, 0, 2, 1, 1, 2, 0.1]])

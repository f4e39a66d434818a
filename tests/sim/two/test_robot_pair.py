"""The distance of two robots is that of the exact solids of both."""

import numpy as np
import pytest
from small import DATA

from odm.exact.distances import ExactRobot
from odm.obstacles.robot_surface import solids_of
from roadmap import load_robot
from roadmap.errors import BadInput
from roadmap.kinematics.forward import body_frames
from roadmap.transforms import pose_of
from sim.two.robot_pair import ExactPair

T = pose_of((0.6, 0.1, 0.05), (0.1, 0.0, 2.5))


@pytest.fixture(scope="module")
def arm3():
    return load_robot(DATA / "arm3.urdf", tip="tool")


def test_it_is_the_distance_from_the_others_solids_as_shapes(arm3, rng):
    pair, exact = ExactPair(arm3, arm3, T), ExactRobot(arm3, base=True)
    touching = 0
    for _ in range(60):
        q = rng.uniform(arm3.lower, arm3.upper, (2, 3))
        frames = body_frames(arm3, q[1])[arm3.link_body[arm3.solid_link]]
        solids = solids_of(arm3)
        shapes = [s.moved(T @ f) for s, f in zip(solids, frames, strict=True)]
        true = exact.distance(q[0], shapes).distance
        assert np.isclose(pair.distance(*q), true, atol=1e-9)
        touching += true <= 0.0
    assert 0 < touching < 60


def test_it_is_the_same_from_both_sides(arm3, rng):
    there, back = ExactPair(arm3, arm3, T), ExactPair(arm3, arm3, np.linalg.inv(T))
    for _ in range(20):
        a, b = rng.uniform(arm3.lower, arm3.upper, (2, 3))
        assert np.isclose(there.distance(a, b), back.distance(b, a), atol=1e-8)


def test_bases_that_always_meet_are_refused(arm3):
    # round feet of radius 0.08
    ExactPair(arm3, arm3, pose_of((0.18, 0.0, 0.0))).require_apart(0.01)
    with pytest.raises(BadInput, match=r"0.5 cm apart.*move the second base away"):
        ExactPair(arm3, arm3, pose_of((0.165, 0.0, 0.0))).require_apart(0.01)
    with pytest.raises(BadInput, match="always be in contact"):
        ExactPair(arm3, arm3, pose_of((0.05, 0.0, 0.0))).require_apart(0.01)

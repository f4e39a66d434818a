"""A scene of one arm each, and few grasps, for all tests of this folder."""

from dataclasses import replace

import pytest

import handover
from handover.grasps.grasp_build import GraspSettings

FEW = GraspSettings(samples=16, rolls=6)


@pytest.fixture(scope="session")
def scene():
    scene = handover.load_scene("kneeling", 0)
    # one arm each: half the time
    giver = replace(scene.giver, arms=("left",))
    return replace(scene, giver=giver, receiver=replace(scene.receiver, arms=("left",)))


@pytest.fixture(scope="session")
def grasps():
    jar, hands = handover.load_object("food_jar"), ("sdh_left", "hubo_left")
    return {hand: handover.build_grasps(jar, hand, FEW) for hand in hands}

"""A scene of one arm each, and few grasps, for all tests of this folder."""

from dataclasses import replace

import pytest
from built_once import built_once

import handover
from handover.grasps.grasp_build import GraspSettings

HANDS = ("sdh_left", "hubo_left")
FEW = GraspSettings(samples=16, rolls=6)


@pytest.fixture(scope="session")
def scene():
    scene = handover.load_scene("kneeling", 0)
    # one arm each: half the time
    giver = replace(scene.giver, arms=("left",))
    return replace(scene, giver=giver, receiver=replace(scene.receiver, arms=("left",)))


@pytest.fixture(scope="session")
def grasps(tmp_path_factory):
    folder = built_once(tmp_path_factory, "jar_grasps", _build_grasps)
    return {hand: handover.load_grasps(folder / hand) for hand in HANDS}


def _build_grasps(folder):
    jar = handover.load_object("food_jar")
    for hand in HANDS:
        handover.build_grasps(jar, hand, FEW).save(folder / hand)

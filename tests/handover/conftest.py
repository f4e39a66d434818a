"""Reach maps that many tests share; built once a session."""

import numpy as np
import pytest
from reach_chains import BASE, person_arm

from handover import (
    Human,
    InteractionWorkspace,
    MeetSettings,
    ReachSettings,
    build_reach_map,
    chain_of,
    wrench,
)
from odm import Recipe, build_map
from odm.cell_map.recipe import RobotRecipe
from odm.close_test.safety import Safety
from roadmap import load_robot
from roadmap.graph.connecting import RoadmapSettings

SMALL = ReachSettings(cell=0.2, rotations=72, samples=40_000, seed=3)


@pytest.fixture(scope="session")
def arm():
    """A person-like arm, in units of its length."""
    return person_arm()


@pytest.fixture(scope="session")
def arm_map(arm):
    """Its reach map."""
    return build_reach_map(arm, SMALL, threads=1)


@pytest.fixture(scope="session")
def robot():
    """The Kawasaki: six joints, with self-collision."""
    return load_robot("kawasaki_fs003n", cover_excess=0.1)


@pytest.fixture(scope="session")
def robot_map(robot):
    """Its reach map."""
    settings = ReachSettings(cell=0.1, rotations=72, samples=60_000, seed=3)
    return build_reach_map(chain_of(robot), settings, threads=2)


@pytest.fixture
def rng():
    return np.random.default_rng(20)


@pytest.fixture(scope="session")
def cell_map():
    """A small planner's map of the Kawasaki."""
    recipe = Recipe(
        "kawasaki",
        RobotRecipe(source="kawasaki_fs003n"),
        RoadmapSettings(nodes=250, neighbors=8, seed=3),
        Safety(h=0.06),
    )
    return build_map(recipe, threads=2)


@pytest.fixture(scope="session")
def person_map():
    """The reach map of a person's arm."""
    settings = ReachSettings(cell=0.2, rotations=72, samples=20_000, seed=3)
    return build_reach_map(Human().arm("right").chain(), settings, threads=1)


@pytest.fixture(scope="session")
def meet_of(robot_map, person_map):
    """Return a function that makes a workspace of the Kawasaki."""

    def make(human, obj=None, grasps=4, **settings):
        chosen = {"T_world_base": BASE, "cell": 0.2} | settings
        return InteractionWorkspace(
            robot_map,
            human,
            obj or wrench(),
            grasps,
            MeetSettings(**chosen),
            human_reach=person_map,
        )

    return make

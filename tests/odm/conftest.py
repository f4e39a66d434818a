"""Maps that several tests of the planner share; built once a session."""

from dataclasses import replace

import pytest
from carrying import build_carrying_map
from small import small_recipe

import odm


@pytest.fixture(scope="session")
def carrying_map(tmp_path_factory):
    """The small arm's map with a payload layer, as it is read from disk."""
    return build_carrying_map(tmp_path_factory.mktemp("maps") / "arm3")


@pytest.fixture(scope="session")
def wide_map():
    """4000 nodes for three joints: a search round an obstacle closes hundreds."""
    recipe = small_recipe()
    return odm.build_map(
        replace(recipe, roadmap=replace(recipe.roadmap, nodes=4000, neighbors=8))
    )

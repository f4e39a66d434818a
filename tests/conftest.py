"""Small maps that many tests share; built once a session."""

import numpy as np
import pytest
from small import small_recipe

import odm


@pytest.fixture(scope="session")
def small_map() -> odm.CellMap:
    """A map of the three-joint arm: 150 nodes on a floor."""
    return odm.build_map(small_recipe())


@pytest.fixture
def planner(small_map: odm.CellMap) -> odm.ReactivePlanner:
    """A fresh planner on the small map."""
    return odm.ReactivePlanner(small_map, always_replan=True)


@pytest.fixture
def rng() -> np.random.Generator:
    """A seeded generator."""
    return np.random.default_rng(20)

"""No garbage is collected in a frame; it is between two."""

import gc

import numpy as np
import pytest
from small import AWAY, HOME

import odm
from sim.loop.garbage import NotCollected
from sim.loop.loop import Loop


class Watched(odm.ReactivePlanner):
    """A planner that notes whether garbage could be collected in its frames."""

    def __init__(self, cell_map):
        super().__init__(cell_map)
        self.collects = []

    def step(self, *told, **options):
        self.collects.append(gc.isenabled())
        return super().step(*told, **options)


def test_no_garbage_is_collected_in_a_frame_of_the_loop(small_map):
    planner = Watched(small_map)
    loop = Loop(planner, small_map.robot, np.stack([HOME, AWAY]), None)
    assert gc.isenabled()
    for _ in range(3):
        loop.frame()
        assert gc.isenabled()
    assert planner.collects == [False, False, False]


def test_who_collects_nothing_is_left_at_that():
    gc.disable()
    try:
        with NotCollected():
            assert not gc.isenabled()
        assert not gc.isenabled()
    finally:
        gc.enable()


def test_a_frame_that_fails_leaves_the_collection_on():
    with pytest.raises(ValueError), NotCollected():
        raise ValueError
    assert gc.isenabled()

"""A frame is one compiled call, and two where something has to be judged between."""

import time
from unittest.mock import patch

import numpy as np
import pytest
from small import AWAY, HOME

import odm
from odm.search import _frame, _step

POST = np.array([[0.75, 0.75, 0.0, 0.75, 0.75, 0.5, 0.05]])  # within the grid
CALLS = {
    _frame: ("begin_step", "begin_shapes"),
    _step: ("step_points", "step_shapes", "respond"),
}


@pytest.fixture(params=["points", "shapes"])
def seen(request):
    """Return what stands there, as points or as a shape."""
    if request.param == "points":
        return odm.sample_capsules(POST, 0.03)
    return odm.Obstacles(capsules=POST)


@pytest.fixture
def planner(small_map, seen):
    """Return a planner that follows its path past them."""
    planner = odm.ReactivePlanner(small_map)
    planner.set_goals([AWAY])
    for _ in range(30):
        planner.step(seen, q=HOME)
        planner.improve(8)
    assert planner.step(seen, q=HOME).status == "following"
    return planner


def calls_of(planner, seen, **given):
    """Return the compiled calls that a frame makes, in order."""
    called = []

    def told(name, loop):
        return lambda *args: (called.append(name), loop(*args))[1]

    loops = [(module, name) for module, names in CALLS.items() for name in names]
    if planner.frame.step_again is not None:
        loops.append((planner.frame, "step_again"))
    patches = [
        patch.object(module, name, told(name, getattr(module, name)))
        for module, name in loops
    ]
    for one in patches:
        one.start()
    try:
        planner.step(seen, q=HOME, **given)
    finally:
        patch.stopall()
    return called


def test_a_frame_whose_path_is_kept_is_one_call(planner, seen):
    shapes = isinstance(seen, odm.Obstacles)
    assert calls_of(planner, seen) == ["step_again" if shapes else "step_points"]


def test_the_age_of_a_frame_is_judged_before_it_is_answered(planner, seen):
    begins = "begin_shapes" if isinstance(seen, odm.Obstacles) else "begin_step"
    assert calls_of(planner, seen, stamp=1.0, now=1.01) == [begins, "respond"]
    assert calls_of(planner, seen, stamp=1.0, now=9.0) == [begins]  # too old
    assert planner.last.status == "holding"


def test_one_call_and_two_answer_alike(planner, seen):
    one = planner.step(seen, q=HOME)
    two = planner.step(seen, q=HOME, stamp=1.0, now=1.01)
    assert one.path.tobytes() == two.path.tobytes()
    assert (one.status, one.goal, one.stage) == (two.status, two.goal, two.stage)
    assert (one.path[0] == HOME).all() and two.frame == one.frame + 1


def test_the_stages_are_told_by_the_clock_of_python(planner, seen):
    begun = time.perf_counter_ns()
    stages = planner.step(seen, q=HOME).latency_s
    whole = 1e-9 * (time.perf_counter_ns() - begun)
    assert 0.0 < stages["occupancy"] < stages["total"] <= whole
    assert stages["plan"] == pytest.approx(stages["total"] - stages["occupancy"])


def test_a_path_that_a_search_finds_again_is_followed(small_map):
    planner, held = odm.ReactivePlanner(small_map, True), odm.Obstacles(capsules=POST)
    planner.set_goals([AWAY])
    assert [planner.step(held, q=HOME).status for _ in range(3)] == [
        "replanned",
        "following",
        "following",
    ]
    planner.set_goals([0.5 * (HOME + AWAY), AWAY])
    planner.step(held, q=HOME)  # may join q to the roadmap anew
    planner.set_goals([AWAY])
    assert planner.step(held, q=HOME).status == "replanned"
    assert planner.step(held, q=HOME).status == "following"

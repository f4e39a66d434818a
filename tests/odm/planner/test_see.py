"""A frame that is only seen: questions are answered as after a step, none is asked."""

import itertools

import numpy as np
import pytest
from small import AWAY, HOME, NOBODY, draw_arm, draw_valid

import odm
from roadmap.errors import BadInput


def asked(planner, rng):
    """Return what a planner says of a frame, to questions drawn at random."""
    qs = [draw_valid(planner, rng) for _ in range(4)]
    coming = [(0.2, draw_obstacles(rng))]
    return [
        [planner.is_free(a, b).reason for a, b in itertools.pairwise(qs)],
        planner.blocked_leg(np.array(qs)),
        planner.separation(qs[2]),
        planner.stands_clear(qs[3]),
        planner.invalid_edges().tobytes(),
        str(planner.evasion(HOME, coming, 0.5)),
        str(planner.approach(np.eye(4), HOME)),
    ]


def draw_obstacles(rng):
    return odm.Obstacles(capsules=draw_arm(rng))


@pytest.mark.parametrize("points", [False, True], ids=["shapes", "points"])
def test_questions_are_answered_as_after_a_step(small_map, points):
    for seed in range(6):
        answers = []
        for name in ("see", "step"):
            rng = np.random.default_rng(seed)
            planner = odm.ReactivePlanner(small_map)
            planner.set_goals([AWAY])
            planner.step(NOBODY, q=HOME)
            there = draw_obstacles(rng)
            if points:
                there = odm.sample_capsules(there.capsules, 0.03)
            getattr(planner, name)(there, q=HOME)
            answers.append(asked(planner, rng))
        assert answers[0] == answers[1]


def test_nothing_is_searched_joined_or_bettered(small_map):
    planner = odm.ReactivePlanner(small_map)
    planner.set_goals([AWAY])
    rng = np.random.default_rng(3)
    before = planner.frame_number
    for _ in range(5):
        q = draw_valid(planner, rng)
        assert planner.see(draw_obstacles(rng), q=q) is None
        assert planner.improve(50, q) == 0
    assert planner.frame_number == before + 5
    assert planner.memory.start_connections.count[0] == 0 and len(planner.path) == 0
    assert planner.last is None


def test_the_frame_after_plans_from_where_the_robot_is_then(small_map):
    """It follows its path where it still is on it, and keeps clear in any case."""
    rng = np.random.default_rng(5)
    planner, fresh = (odm.ReactivePlanner(small_map) for _ in range(2))
    for one in (planner, fresh):
        one.set_goals([AWAY])
    assert planner.step(NOBODY, q=HOME).status == "replanned"
    assert planner.step(NOBODY, q=HOME).status == "following"
    assert planner.see(NOBODY, q=HOME) is None
    assert planner.step(NOBODY, q=HOME).status == "following"
    found = 0
    for _ in range(20):
        there, q = draw_obstacles(rng), draw_valid(planner, rng)
        planner.see(draw_obstacles(rng), q=q)
        answer, alone = planner.step(there, q=q), fresh.step(there, q=q)
        for a, b in zip(answer.path[:-1], answer.path[1:], strict=True):
            found += 1
            assert planner.is_free(a, b) and fresh.is_free(a, b)
        assert alone.status in ("replanned", "following", "holding")
    assert found > 10


def test_what_cannot_be_used_is_told_and_makes_every_answer_no(small_map):
    planner = odm.ReactivePlanner(small_map)
    told = planner.see(np.full((3, 3), np.nan), q=HOME)
    assert told is not None and "finite" in told
    assert not planner.is_free(HOME, HOME)
    assert planner.see(NOBODY, q=HOME, stamp=1.0, now=1.0) is None
    assert planner.see(NOBODY, q=HOME, stamp=0.5, now=1.1) is not None  # older
    with pytest.raises(BadInput):
        planner.see(np.zeros((3, 2)), q=HOME)


def test_a_saved_memory_knows_that_the_last_frame_was_only_seen(small_map):
    planner, other = (odm.ReactivePlanner(small_map) for _ in range(2))
    for one in (planner, other):
        one.set_goals([AWAY])
    planner.step(NOBODY, q=HOME)
    planner.see(NOBODY, q=HOME)
    other.load_memory(planner.save_memory())
    assert other.improve(20, HOME) == 0

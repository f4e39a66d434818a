"""What was blocked is looked at first where it was: the verdicts are the same."""

import numpy as np
from small import HOME, draw_valid
from wrappers import with_wrapper

import odm
from odm.search import _items as items
from odm.search import _judge as judge

item_free = with_wrapper(items.item_free)
item_free_now = with_wrapper(items.item_free_now)
stands_free = with_wrapper(judge.stands_free)
PLACED = 3  # of work.found: configurations at which the bodies were placed


def drifting(rng, count):
    """Return capsules that drift, and now and then jump, frame by frame (2, 7)."""
    rods = np.full((2, 7), 0.05)
    for k in range(count):
        if k % 8 == 0:
            rods[:, :6] = 0.3 * rng.normal(size=(2, 6))
        rods[:, :6] += np.tile(0.01 * rng.normal(size=(2, 3)), 2)
        yield odm.Obstacles(capsules=rods)


def test_a_place_is_blocked_as_if_nothing_were_remembered(small_map, rng):
    planner = odm.ReactivePlanner(small_map)
    kept, found = planner.memory.blocked_places, planner.memory.work.found
    places = [draw_valid(planner, rng) for _ in range(5)]
    again = came_free = 0
    for frame in drifting(rng, 120):
        planner.step(frame, q=HOME)
        for q in places:
            table, known = planner.memory.table, (kept.q == q).all(axis=1).any()
            placed = found[PLACED]
            free = stands_free(table, q)
            again += known and found[PLACED] == placed
            came_free += known and free
            held = [array.copy() for array in kept]
            kept.q[:] = np.nan
            assert stands_free(table, q) == free
            for array, before in zip(kept, held, strict=True):
                array[:] = before
    assert again > 40 and came_free > 20


def test_an_item_is_hit_as_the_direct_map_has_it(small_map, rng):
    planner = odm.ReactivePlanner(small_map, always_replan=True)
    search, n = planner.memory.search, small_map.roadmap.n_nodes
    edges, again = small_map.roadmap.edges, 0
    for k, frame in enumerate(drifting(rng, 30)):
        planner.step(frame, q=HOME)
        search.memo[:], search.hits[0] = -1, 0
        table, places = planner.memory.table, search.hit_at.copy()
        ask = item_free_now if k % 2 else item_free
        free = np.array([ask(table, i) for i in range(len(search.memo))])
        hit = np.zeros(len(free), bool)
        hit[planner.direct.nodes()] = hit[n + planner.direct.edges()] = True
        own = free.copy()  # an edge of the direct map counts its nodes, too
        own[n:] &= free[edges[:, 0]] & free[edges[:, 1]]
        assert (own == ~hit).all()
        assert (search.hit_at[~free, 0] > 0).all()
        again += (~free & (places == search.hit_at).all(axis=1)).sum()
        assert search.hits[0] == (~free).sum()
    assert again > 1000

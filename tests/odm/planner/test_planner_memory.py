"""What a planner keeps between frames and goals, and what it must not."""

import gc
import weakref

import numpy as np
from small import AWAY, HOME, NOBODY, POST, draw_arm, draw_valid, wrapped

import odm


def test_a_goal_that_is_a_node_needs_no_attachment(small_map, planner):
    node = small_map.roadmap.nodes[7]
    planner.set_goals([node])
    assert planner.memory.goals.number[0] == 1
    answer = planner.step(NOBODY, q=small_map.roadmap.nodes[90].copy())
    assert np.allclose(wrapped(small_map, answer.path[-1] - node), 0)


def test_unchanged_goals_are_not_attached_again(planner):
    planner.set_goals([AWAY])
    used = planner.memory.pool.used.copy()
    planner.set_goals([AWAY.copy()])
    assert np.array_equal(planner.memory.pool.used, used)


def test_many_goals_do_not_fill_the_memory(small_map, planner, rng):
    for _ in range(600):
        planner.set_goals([draw_valid(planner, rng)])
        assert planner.step(NOBODY, q=HOME).status != "holding"
    items, entries = planner.memory.pool.used
    assert items < len(planner.memory.pool.begin)
    assert entries < len(planner.memory.pool.block)


def test_one_planner_does_not_depend_on_what_another_did(small_map, rng):
    a, b = odm.ReactivePlanner(small_map), odm.ReactivePlanner(small_map)
    points = odm.sample_capsules(draw_arm(rng), 0.03)
    a.set_goals([AWAY])
    for _ in range(5):
        b.set_goals([draw_valid(b, rng)])
        b.step(points, q=draw_valid(b, rng))
    b.reset()
    b.set_goals([AWAY])
    assert np.array_equal(a.step(points, q=HOME).path, b.step(points, q=HOME).path)


def test_nothing_is_allocated_in_a_frame_but_the_answer(small_map):
    import tracemalloc

    planner = odm.ReactivePlanner(small_map, always_replan=True)
    planner.set_goals([AWAY])
    points = odm.sample_capsules(POST, 0.03)
    for _ in range(50):
        planner.step(points, q=HOME)
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    for _ in range(500):
        planner.step(points, q=HOME)
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert grown < 4096


def test_no_kernel_is_compiled_again_for_another_map(small_map, tmp_path):
    from odm.search import _frame as frame
    from odm.search import _step as step

    small_map.save(tmp_path / "map")
    loaded = odm.load_map(tmp_path / "map")
    kernels = (step.respond, frame.take_points)
    planner = odm.ReactivePlanner(small_map)
    planner.set_goals([AWAY])
    planner.step(odm.sample_capsules(POST, 0.03), q=HOME)
    seen = [len(k.signatures) for k in kernels]
    other = odm.ReactivePlanner(loaded)
    other.set_goals([AWAY])
    other.step(odm.sample_capsules(POST, 0.03), q=HOME)
    assert [len(k.signatures) for k in kernels] == seen


def test_read_only_arrays_do_not_make_the_frame_compile(small_map, planner):
    from odm.search import _frame as frame
    from odm.search import _step as step

    kernels = step.respond, frame.take_points, frame.begin_step, frame.begin_shapes
    planner.set_goals([AWAY])
    points, q = odm.sample_capsules(POST, 0.03), np.array(HOME)
    shapes = odm.Obstacles(capsules=POST, points=points)
    for given in (points, shapes, points):
        planner.step(given, q=q)
    seen = [len(kernel.signatures) for kernel in kernels]
    for array in (points, q):  # the very arrays that the frames before had
        array.flags.writeable = False
        for given in (points, shapes, points):
            planner.step(given, q=q)
    planner.step(points, q=small_map.roadmap.nodes[3])
    assert [len(kernel.signatures) for kernel in kernels] == seen


def test_an_array_that_is_written_anew_is_read_anew(planner):
    planner.set_goals([AWAY])
    points, q = odm.sample_capsules(POST, 0.03) + [9.0, 0.0, 0.0], np.array(HOME)
    assert planner.step(points, q=q).status != "holding"
    points -= [9.0, 0.0, 0.0]
    fresh = odm.ReactivePlanner(planner.cell_map)
    fresh.set_goals([AWAY])
    told = [p.step(points, q=q) for p in (planner, fresh)]
    assert np.array_equal(planner.invalid_nodes(), fresh.invalid_nodes())
    assert len(planner.invalid_nodes()) and told[0].status
    q += 0.1
    assert np.array_equal(planner.step(points, q=q).path[0], q)


def test_the_memory_is_freed_with_its_last_user_without_a_search_for_garbage(small_map):
    nodes = small_map.roadmap.nodes
    gc.collect()
    gc.disable()  # tens of megabytes would wait for it, in who makes one after another
    try:
        planner = odm.ReactivePlanner(small_map)
        planner.set_goals([nodes[-1]])
        far = np.eye(4)
        far[2, 3] = 3.0
        planner.scene.add("ball", odm.Sphere(0.01, far))
        planner.step(np.zeros((0, 3)), q=nodes[0])
        planner.improve(4)
        gone = weakref.ref(planner), weakref.ref(planner.frame)
        scene = planner.scene  # who keeps the scene keeps no planner
        del planner
        assert gone[0]() is None
        scene.remove("ball")
        del scene
        assert gone[1]() is None
    finally:
        gc.enable()

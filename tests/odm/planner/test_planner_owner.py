"""A planner is one thread's own, is never copied, and nothing makes its table stale."""

import copy
import pickle
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from rows import each
from small import AWAY, HOME, NOBODY, POST, ball_at

import odm
from odm.approach.approach import Approacher
from roadmap.errors import BadInput, BadMap
from roadmap.transforms import pose_of

BALL = ball_at([0.3, 0.0, 0.35])  # in the arm at HOME
SPHERE = odm.Sphere(0.05, pose_of([0.4, 0.0, 0.4]))


@pytest.fixture
def held(planner):
    """A planner that holds, since the ball is in the arm."""
    planner.set_goals([AWAY])
    assert planner.step(BALL, q=HOME).status == "holding"
    return planner


def in_thread(question):
    """Return what a question raises in another thread, or what it returns."""
    box = []

    def run():
        try:
            box.append(question())
        except BaseException as error:
            box.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    return box[0]


# --- changes that are cut short ------------------------------------------------------


@pytest.mark.parametrize(
    "change",
    [
        lambda planner: planner.set_base(np.eye(4)),
        lambda planner: planner.set_static(NOBODY),
        lambda planner: planner.set_extra_clearance(0.01),
        lambda planner: planner.scene.add("ball", SPHERE),
    ],
)
def test_who_is_cut_in_two_by_ctrl_c_answers_nobody(held, monkeypatch, change):
    def cut(*rest, **named):
        raise KeyboardInterrupt

    monkeypatch.setattr(held.carrier, "set_place", cut)
    held.carrier.things = {"post": None}  # something stood there
    with pytest.raises(KeyboardInterrupt):
        change(held)
    held.take_over()
    for question in (
        lambda: held.step(NOBODY, q=HOME),
        lambda: held.see(NOBODY, q=HOME),
        lambda: held.is_free(HOME, AWAY),
        lambda: held.invalid_edges(),
        lambda: held.set_base(np.eye(4)),
        lambda: held.improve(4),
    ):
        with pytest.raises(BadInput, match=r"cut short.*; make another one"):
            question()


def test_what_is_refused_cuts_nothing_short(held):
    with pytest.raises(BadInput):
        held.set_base(np.zeros((4, 4)))
    with pytest.raises(BadInput):
        held.detach()
    assert held.step(NOBODY, q=HOME).status != "holding"


# --- copies -----------------------------------------------------------------------


@each("copied", [copy.copy, copy.deepcopy, pickle.dumps])
@each(
    "part",
    [
        lambda planner: planner,
        lambda planner: planner.memory,
        lambda planner: [{"planner": planner}],
    ],
)
def test_a_planner_refuses_to_be_copied_in_one_sentence(held, copied, part):
    if copied is copy.copy and isinstance(part(held), list):
        return  # a list's own copy shares the planner
    with pytest.raises(BadInput, match=r"make another planner on the same map"):
        copied(part(held))


def test_what_holds_a_planner_refuses_with_it(held):
    for thing in (held.direct, held.attacher, held.smoother, Approacher(held.frame)):
        for copied in (copy.deepcopy, pickle.dumps):
            with pytest.raises(BadInput, match="cannot be copied"):
                copied(thing)


def test_a_refused_copy_leaves_the_planner_as_it_was(held):
    edges = held.invalid_edges()
    assert len(edges)
    with pytest.raises(BadInput):
        copy.deepcopy(held).step(NOBODY, q=HOME)
    assert not held.is_free(HOME, HOME)
    assert np.array_equal(held.invalid_edges(), edges)


def test_an_answer_can_be_pickled_and_tells_the_same(held):
    answer = held.step(BALL, q=HOME)
    for other in (pickle.loads(pickle.dumps(answer)), copy.deepcopy(answer)):
        assert other.reason == answer.reason and "in contact" in other.reason
        assert other.work == answer.work


# --- maps -------------------------------------------------------------------------


def test_a_loaded_map_pickles_by_its_folder(small_map, tmp_path):
    loaded = odm.load_map(small_map.save(tmp_path / "map"))
    data = pickle.dumps(loaded)
    assert len(data) < 1000
    other = pickle.loads(data)
    assert other.hash == loaded.hash
    planner = odm.ReactivePlanner(other)
    planner.set_goals([AWAY])
    assert planner.step(NOBODY, q=HOME).status == "replanned"


def test_a_map_that_changed_since_it_was_pickled_is_refused(small_map, tmp_path):
    data = pickle.dumps(odm.load_map(small_map.save(tmp_path / "map")))
    recipe = replace(small_map.recipe, name="other")
    replace(small_map, recipe=recipe).save(tmp_path / "map")
    with pytest.raises(BadMap, match="pickle the map again"):
        pickle.loads(data)


def test_a_map_that_lies_nowhere_does_not_pickle(small_map, tmp_path):
    loaded = odm.load_map(small_map.save(tmp_path / "map"))
    for cell_map in (small_map, replace(loaded, built={"seconds": 3})):
        with pytest.raises(BadInput, match="save it"):
            pickle.dumps(cell_map)


def test_a_copy_of_a_map_is_the_map(small_map):
    assert copy.deepcopy(small_map) is small_map and copy.copy(small_map) is small_map


# --- threads ----------------------------------------------------------------------

METHODS = {
    "step": lambda p: p.step(NOBODY, q=HOME),
    "see": lambda p: p.see(NOBODY, q=HOME),
    "set_goals": lambda p: p.set_goals([HOME]),
    "prepare_goal": lambda p: p.prepare_goal(HOME),
    "is_prepared": lambda p: p.is_prepared(HOME),
    "is_free": lambda p: p.is_free(HOME, AWAY),
    "stands_clear": lambda p: p.stands_clear(HOME),
    "separation": lambda p: p.separation(HOME),
    "invalid_nodes": lambda p: p.invalid_nodes(),
    "invalid_edges": lambda p: p.invalid_edges(),
    "direct": lambda p: p.direct.edges(),
    "clear": lambda p: p.direct.clear(),
    "approach": lambda p: p.approach(np.eye(4)),
    "blocked_leg": lambda p: p.blocked_leg(HOME[None]),
    "evasion": lambda p: p.evasion(HOME, [(0.1, BALL)], 0.5),
    "cover": lambda p: p.cover(),
    "reason": lambda p: p.last.reason,
    "retreat": lambda p: p.last.retreat,
    "improve": lambda p: p.improve(),
    "reset": lambda p: p.reset(),
    "attach": lambda p: p.attach(np.array([[0, 0, 0, 0.01]])),
    "detach": lambda p: p.detach(),
    "set_static": lambda p: p.set_static(NOBODY),
    "set_base": lambda p: p.set_base(np.eye(4)),
    "set_extra_clearance": lambda p: p.set_extra_clearance(0.0),
}


@pytest.mark.parametrize("method", METHODS)
def test_another_thread_is_refused_by_every_method(held, method):
    told = in_thread(lambda: METHODS[method](held))
    assert isinstance(told, BadInput), told
    assert "the planner belongs to thread" in str(told) and "take_over" in str(told)
    assert not held.is_free(HOME, HOME)  # and the frame is still there


def test_a_thread_that_takes_a_planner_over_is_served(held):
    def served():
        held.take_over()
        return bool(held.is_free(HOME, HOME)), held.step(NOBODY, q=HOME).status

    assert in_thread(served) == (False, "replanned")
    with pytest.raises(BadInput, match="belongs to thread"):
        held.step(NOBODY, q=HOME)
    held.take_over()
    assert held.is_free(HOME, HOME)


def test_a_reason_once_told_is_read_by_any_thread(held):
    told = held.last.reason, held.last.retreat
    assert in_thread(lambda: held.last.reason) == told[0]


def test_questions_of_a_thread_do_not_crash_while_frames_make_room(small_map):
    """Ended in a segmentation fault: the table pointed at arrays that were gone."""
    settings = odm.PlannerSettings(point_capacity=1)
    planner = odm.ReactivePlanner(small_map, settings=settings)
    planner.set_goals([AWAY])
    said, stop = [], threading.Event()

    def ask():
        while not stop.is_set():
            try:
                said.append(planner.separation(HOME))
            except BadInput as error:
                said.append(error)
            time.sleep(1e-4)

    thread = threading.Thread(target=ask)
    thread.start()
    cloud = odm.sample_capsules(POST, 0.03)
    for k in range(1, 12):
        planner.step(np.tile(cloud, (2**k, 1)), q=HOME)
    stop.set()
    thread.join()
    assert said and all(isinstance(row, BadInput) for row in said)


def test_to_know_the_thread_takes_less_than_two_calls_that_do_little(planner):
    """Both are timed in turn, so that a busy machine slows both."""
    check, many = planner.memory.owner.check, 20_000

    def taken(call):
        begin = time.thread_time()
        for _ in range(many):
            call()
        return time.thread_time() - begin

    rounds = [(taken(check), taken(threading.current_thread)) for _ in range(15)]
    ours, little = np.min(rounds, axis=0)
    assert ours < 2.0 * little


# --- the table --------------------------------------------------------------------


def test_nothing_public_makes_room_or_exchanges_the_arrays(held):
    for thing in (held, held.memory):
        for name in ("make_room", "exchange", "replace_clouds"):
            assert not hasattr(thing, name)


def test_who_writes_into_the_cover_that_is_told_frees_nothing(held):
    before = held.separation(HOME)
    assert not held.stands_clear(HOME)
    cover = held.cover()
    for array in (cover.radii, cover.bare, *cover.arm):
        array[:] = 0
    assert not held.stands_clear(HOME) and held.separation(HOME) == before


def test_room_never_shrinks_and_what_was_marked_stays(held):
    before, edges = held.separation(HOME), held.invalid_edges()
    room = len(held.memory.cloud.where)
    held.frame.grow_clouds(1)
    assert len(held.memory.cloud.where) == room
    assert held.separation(HOME) == before and not held.is_free(HOME, HOME)
    assert np.array_equal(held.invalid_edges(), edges)


@each("name", ["cloud", "robot_state", "table", "owner", "anything"])
def test_an_array_of_the_memory_cannot_be_replaced(held, name):
    with pytest.raises(BadInput, match=f"{name} of a planner's memory cannot be"):
        setattr(held.memory, name, held.cell_map.grid.new_cloud(1))


def test_a_planner_keeps_its_memory_and_its_frame_the_radii(held):
    for thing, name in ((held, "memory"), (held.frame, "radii")):
        with pytest.raises(AttributeError):
            setattr(thing, name, None)

"""Frames that come by the same arrays are taken as those that come by new ones."""

from unittest.mock import patch

import numpy as np
import pytest
from small import AWAY, HOME, draw_arm, draw_valid

import odm
from odm.frame.frame import compiled_step_again
from roadmap.arrays import lent
from roadmap.errors import BadInput

FAR = np.array([[5.0, 5.0, 0.0, 5.0, 5.0, 0.5, 0.05]] * 2)


def told(answer):
    """Return all that an answer says but for its times."""
    work, frame = answer.work, answer.frame
    said = answer.status, answer.goal, answer.certified, answer.stage, answer.held
    return *said, answer.path.tobytes(), answer.reason, frame, work


def draw_extras(rng, timed):
    """Draw what else a frame may be told, mostly nothing."""
    extras = [{}] * 6 + [
        {"closed": True},
        {"dq": np.zeros(3)},
        {"covering_radius": 0.02},
        {"rounding": 0.04},
    ]
    if timed:  # who told a time once is asked for it: such frames are never the same
        extras += [{"stamp": 1.0, "now": 1.01}, {"now": 2.0}]
    return extras[rng.integers(len(extras))]


def test_same_arrays_and_new_ones_answer_alike(small_map):
    rng = np.random.default_rng(7)
    same, new = odm.ReactivePlanner(small_map), odm.ReactivePlanner(small_map)
    for planner in (same, new):
        planner.set_goals([AWAY, draw_valid(planner, np.random.default_rng(1))])
    held = odm.Obstacles(capsules=2)
    q = HOME.copy()
    some = [draw_arm(rng)[:, :3] for _ in range(3)]  # points where the robot moves
    for k in range(400):
        rods = draw_arm(rng) if rng.random() < 0.7 else FAR
        rods = np.full((2, 7), np.nan) if rng.random() < 0.05 else rods
        held.capsules[:] = rods
        if rng.random() < 0.3:
            held.points = some[k % 3] if rng.random() < 0.7 else np.zeros((0, 3))
        if rng.random() < 0.2:
            q[:] = same.last.path[1] if same.last and len(same.last.path) > 1 else HOME
        asked, extras = q, draw_extras(rng, timed=k > 300)
        if k % 5 == 0:
            asked = q.copy() if k % 2 else q.astype(np.float32)
            asked.flags.writeable = rng.random() < 0.5
        if rng.random() < 0.1:
            what = rng.integers(4)
            for planner in (same, new):
                if what == 0:
                    planner.see(odm.Obstacles(capsules=rods), q)
                elif what == 1:
                    planner.improve(4)
                elif what == 2:
                    planner.set_goals([AWAY])
                else:
                    planner.step(some[0], q=q)
        once = odm.Obstacles(capsules=rods, points=held.points)
        a = same.step(held, q=asked, **extras)
        b = new.step(once, q=np.array(asked, float), **extras)
        assert told(a) == told(b), k


def calls_past_the_checks(planner, held, q, **extras):
    """Return whether a frame was taken without another look at its arrays."""
    real = planner.frame.checked
    with patch.object(planner.frame, "checked", side_effect=real) as checked:
        planner.step(held, q=q, **extras)
    return not checked.called


@pytest.fixture
def standing(small_map):
    """Return a planner on its way, and the obstacles that it has seen."""
    planner, held = odm.ReactivePlanner(small_map), odm.Obstacles(capsules=FAR)
    planner.set_goals([AWAY])
    for _ in range(5):
        planner.step(held, q=HOME)
    return planner, held


def test_what_is_told_by_the_same_arrays_is_looked_at_once(standing):
    planner, held = standing
    assert calls_past_the_checks(planner, held, HOME)
    assert calls_past_the_checks(planner, held, HOME.copy())
    assert not calls_past_the_checks(planner, held, HOME, stamp=1.0, now=1.0)
    assert not calls_past_the_checks(planner, odm.Obstacles(capsules=FAR), HOME)


def test_classes_and_points_that_came_meanwhile_are_heeded(standing):
    planner, held = standing
    held.points = np.array([[5.0, 5.0, 5.0]])
    assert not calls_past_the_checks(planner, held, HOME)
    assert calls_past_the_checks(planner, held, HOME)
    held.classes = np.array([odm.OBJECT])
    assert not calls_past_the_checks(planner, held, HOME)
    assert planner.frame.classes.tolist() == [odm.OBJECT]
    held.classes = None
    planner.step(held, q=HOME)
    assert planner.frame.classes is None


def test_what_was_told_of_the_last_frame_alone_is_forgotten(standing):
    planner, held = standing
    planner.step(held, q=HOME, covering_radius=0.01)
    assert not calls_past_the_checks(planner, held, HOME)
    assert planner.frame.sampled == (None, None)
    held.capsules[:] = [[0.75, 0.75, 0.0, 0.75, 0.75, 0.5, 0.05]] * 2  # in the grid
    planner.step(held, q=HOME, stamp=1.0, now=1.0)  # who sees nothing now is blind
    assert not calls_past_the_checks(planner, held, HOME)


def test_points_that_became_fewer_in_place_are_counted_again(standing):
    planner, held = standing
    held.points = np.full((40, 3), 5.0)
    for _ in range(2):
        planner.step(held, q=HOME)
    held.points.resize((20, 3), refcheck=False)
    planner.step(held, q=HOME)
    assert planner.frame.n_given == 20


def test_what_cannot_be_used_is_refused_as_ever(standing):
    planner, held = standing
    with pytest.raises(BadInput, match="q has shape"):
        planner.step(held, q=np.zeros(2))
    with pytest.raises(BadInput, match="beside Obstacles"):
        planner.step(held, q=HOME, classes=np.zeros(0, int))
    held.capsules[1] = np.nan
    answer = planner.step(held, q=HOME)
    assert answer.status == "holding"
    assert "capsule 1" in answer.reason
    held.capsules[:] = FAR
    assert planner.step(held, q=HOME).status != "holding"


def test_a_mesh_that_was_refused_is_no_frame_that_was_taken(small_map):
    corners = 30.0 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    planner = odm.ReactivePlanner(small_map)
    planner.set_goals([AWAY])
    small = odm.Obstacles(meshes=[odm.Mesh.hull_of(0.01 * corners, np.eye(4))])
    large = odm.Obstacles(meshes=[odm.Mesh.hull_of(corners, np.eye(4))])
    planner.step(small, q=HOME)
    for _ in range(2):  # not as the small one, which is laid out
        with pytest.raises(BadInput, match="mesh"):
            planner.step(large, q=HOME)


def test_a_read_only_q_is_read_where_it_lies(standing):
    planner, held = standing
    q = HOME.copy()
    q.flags.writeable = False
    view = lent(q)
    assert view.flags.carray
    assert view.__array_interface__["data"][0] == q.__array_interface__["data"][0]
    types = []
    planner.step(held, q=q)
    frame = planner.frame
    with patch.object(frame, "step_again", side_effect=frame.step_again) as call:
        for _ in range(2):
            planner.step(held, q=q)
            types.append(call.call_args.args[-1].flags.writeable)
    assert types == [True, True]  # a read-only array would be compiled for
    table = planner.memory.table  # of a map of more blocks it has another type
    assert frame.step_again is compiled_step_again(table.dtype)
    q.flags.writeable = True
    q[0] += 0.01  # the very array, written in place
    assert planner.step(held, q=q).path[0].tobytes() == q.tobytes()
    single = HOME.astype(np.float32)
    for _ in range(2):
        single[0] += 0.01
        assert (planner.step(held, q=single).path[0] == single).all()


def test_samples_lie_in_the_frames_array_after_a_base_brought_shapes_near(small_map):
    """There was no room for as many; since then another array holds the points."""
    spot = np.array([0.75, 0.75, 0.1, 0.75, 0.75, 0.11, 0.02])  # few samples
    wall = np.array([0.3, 0.3, 50.4, 0.7, 0.3, 50.4, 0.05])
    low, down = np.eye(4), np.array([0, 0, 50.0, 0, 0, 50.0, 0])
    low[2, 3] = 50.0
    settings = odm.PlannerSettings(point_capacity=20)
    planner = odm.ReactivePlanner(small_map, settings=settings)
    planner.set_goals([AWAY])
    held = odm.Obstacles(capsules=[spot, wall])
    for _ in range(3):
        planner.step(held, q=HOME)
    assert len(planner.points) < 20
    planner.set_base(low)
    assert len(planner.points) > 20
    held.capsules[:] = spot + down, wall - down
    planner.step(held, q=HOME)
    once = odm.ReactivePlanner(small_map)
    once.set_base(low)
    once.step(odm.Obstacles(capsules=[spot + down, wall - down]), q=HOME)
    assert planner.points.tobytes() == once.points.tobytes() != b""


def test_samples_lie_in_the_frames_array_after_more_room_was_made(small_map):
    spot = np.array([0.75, 0.75, 0.1, 0.75, 0.75, 0.11, 0.02])  # few samples
    wall = np.array([0.6, 0.3, 0.4, 0.9, 0.3, 0.4, 0.05])
    settings = odm.PlannerSettings(point_capacity=20)
    planner = odm.ReactivePlanner(small_map, settings=settings)
    planner.set_goals([AWAY])
    held = odm.Obstacles(capsules=[spot] * 2)
    planner.step(held, q=HOME)
    room = planner.points.base
    for rod in (spot, wall, spot, spot):
        held.capsules[:] = rod
        planner.step(held, q=HOME)
        once = odm.ReactivePlanner(small_map)
        once.step(held, q=HOME)
        assert planner.points.tobytes() == once.points.tobytes() != b""
    assert planner.points.base is not room

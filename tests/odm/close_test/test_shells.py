"""What the links sweep is apart, or leaves what is near, as exact geometry says."""

import numpy as np
import pytest
from forms import size
from naive_hull import hull_distance
from shapes_drawn import KINDS, least_on, near_a_link, solids_of
from small import draw_valid, plates

import odm
from odm.close_test._close import ESCAPE_SLACK
from odm.close_test._shells import hulls_apart
from odm.close_test.shells import TOUCH, Hulls, Shells
from odm.exact.distances import ExactRobot, obstacles_of
from odm.planner.retreat import Retreat
from odm.planner.settings import RetreatSettings

BASE = np.array([1.0, 0, 0, 0, 1.0, 0, 0, 0, 1.0, 0, 0, 0])
OUT = 1.2e-3  # [m] a shell, or the prism around a cylinder, sticks out so far at most


def test_hulls_are_apart_where_they_are_by_their_definition(rng):
    room, told = np.zeros((17, 3)), []
    for _ in range(300):
        hulls = [rng.normal(0.0, 0.1, (int(rng.integers(4, 9)), 3)) for _ in range(2)]
        rods = rng.normal(0.0, 0.4, (2, 2, 3))
        points = np.vstack([*hulls, *rods])
        ptr = np.r_[0, np.cumsum([len(h) for h in (*hulls, *rods)])]
        radii, slack = rng.uniform(0.0, 0.1, 2), rng.uniform(0.0, 0.01, 2)
        least, free = rng.uniform(0.01, 0.04, (2, 2)), np.zeros((2, 2), bool)
        apart = hulls_apart(points, ptr, slack, radii, least, BASE, room, free)
        gaps = [[hull_distance(hull, *rod) for rod in rods] for hull in hulls]
        more = np.array(gaps) - radii - slack[:, None] - least
        told.append(apart)
        assert apart == free.all()
        assert ((free == (more >= 0.0)) | (abs(more) < 1e-6)).all()
    assert 30 < sum(told) < 270


@pytest.mark.parametrize("kind", [*KINDS, "point"])
def test_no_link_that_leaves_comes_nearer(planner, rng, kind):
    exact, shells, m = ExactRobot(planner.robot), Shells(planner.robot), 0.01
    told = []
    for _ in range(size(75, 150)):
        q, dq = draw_valid(planner, rng), rng.normal(0.0, 0.3, planner.robot.dof)
        there = near_a_link(exact, q, "sphere" if kind == "point" else kind, rng)
        if there is None:
            continue
        shape, now = there
        solids, points = solids_of([shape]), np.zeros((0, 3))
        if kind == "point":
            shape = odm.Sphere(1e-6, shape.T_base_shape)
            points, solids = shape.T_base_shape[None, :3, 3], solids_of([])
            now = exact.distance(q, [shape], cap=0.05).distance
        if now < OUT + TOUCH:
            continue
        shells.show(Hulls.of(points, solids))
        told.append(shells.leave(q, dq, shells.needs(q, m)))
        if told[-1]:
            kept = min(m, max(now - OUT - ESCAPE_SLACK, 0.5 * (now - OUT)))
            assert least_on(exact, q, dq, obstacles_of([shape])) > kept - 1e-6
    assert sum(told) > 10 and len(told) > sum(told)


def test_what_was_proved_of_a_motion_is_not_asked_of_its_halves(planner, rng):
    shells, halved = Shells(planner.robot), 0
    apart, asked = shells.apart, []

    def told(least):
        answer = apart(least)
        asked.append((np.broadcast_to(least, shells._free.shape), shells._free.copy()))
        return answer

    shells.apart = told
    for _ in range(150):
        q, dq = draw_valid(planner, rng), rng.normal(0.0, 0.6, planner.robot.dof)
        shells.show(Hulls.of(rng.uniform(-0.6, 0.6, (8, 3)), solids_of([])))
        needs = shells.needs(q, 0.01)
        asked.clear()
        shells.leave(q, dq, needs)
        for (_, free), (least, _) in zip(asked[:1], asked[1:2], strict=False):
            assert (np.isinf(least) | ~free).all() and (least == needs)[~free].all()
            halved += 1
    assert halved > 5


def test_what_is_no_number_is_not_left(planner):
    shells, q = Shells(planner.robot), np.zeros(planner.robot.dof)
    for place, start in ((np.nan, 0.0), (5.0, np.nan), (5.0, 0.0)):
        shells.show(Hulls.of(np.full((1, 3), place), solids_of([])))
        needs = shells.needs(q + start, 0.01)
        free = shells.leave(q + start, q + 0.1, needs)
        assert free == bool(place + start == 5.0)


def test_no_retreat_from_within_the_cover_touches(tmp_path):
    planner, rng = plates(tmp_path), np.random.default_rng(48)
    exact, found = ExactRobot(planner.robot), 0
    retreat = Retreat(planner.frame, planner.attacher)
    for _ in range(80):
        q = draw_valid(planner, rng)
        there = near_a_link(exact, q, str(rng.choice(KINDS)), rng)
        if there is None or there[1] < OUT + TOUCH:
            continue
        planner.step(odm.Obstacles.of([there[0]]), q=q)
        out = retreat.back_off(q)
        # a direction that the cover refuses costs no test by the links
        none = Retreat(planner.frame, planner.attacher, RetreatSettings(tried=1))
        none._is_clear, none._links_leave = lambda *_: False, None
        assert none.back_off(q) is None
        if out is not None:
            found += 1
            assert least_on(exact, q, out[1] - q, obstacles_of([there[0]])) > 0.0
    assert found > 20

"""A finer sphere cover of what the tool carries, for the last centimetres.

The map's cover is coarse, since every cell list pays for it: a sphere may stick out of
its link by `cover_excess`. A hand in a bin cannot afford that. Here the links of the
outermost bodies, those that enter the bin, are covered anew, by the same proof
(`roadmap.geometry.spheres`), as tightly as 60 spheres per link allow. All other links
keep the map's spheres. The close test runs with this cover as with the other.
"""

from dataclasses import replace

import numpy as np

from odm.close_test.close_test import CloseTest
from odm.close_test.static import StaticTest
from odm.frame.frame import Cover, Frame
from roadmap.geometry.kept_covers import kept_cover
from roadmap.geometry.spheres import robot_solids
from roadmap.kinematics.axis_reach import joint_span, point_reach
from roadmap.kinematics.joint_tree import PARENT
from roadmap.loading.held_link import hanging_on, with_payload
from roadmap.robot.robot import Robot

EXCESS = 0.006  # [m] asked for; 60 spheres per link may give more
_MOST_KEPT = 8
_kept: dict[str, Robot] = {}  # by the bare robot


def fine_robot(robot: Robot) -> Robot:
    """Return the robot with tighter spheres on its outermost links.

    Takes about a second per link, once on a machine. The same robot gives the
    same spheres.
    """
    key = robot.fingerprint()
    if key not in _kept:
        if len(_kept) == _MOST_KEPT:
            del _kept[next(iter(_kept))]
        _kept[key] = _covered(robot)
    return _kept[key]


def _covered(robot: Robot) -> Robot:
    links = [k for k, b in enumerate(robot.link_body) if b in outer_bodies(robot)]
    solids = robot_solids(robot)
    parts = {k: [s for s in solids if s.link == k] for k in links}
    covers = {k: kept_cover(parts[k], EXCESS, False) for k in links if parts[k]}
    stays = ~np.isin(robot.sphere_link, list(covers))
    spheres = np.concatenate([robot.spheres[stays], *covers.values()])
    link = np.concatenate(
        [robot.sphere_link[stays], *(np.full(len(c), k) for k, c in covers.items())]
    ).astype(np.int32)
    body = robot.link_body[link]
    span = joint_span(robot.tree_i, robot.tree_f, robot.lower, robot.upper)
    new = int(stays.sum())
    reach = point_reach(robot.tree_i, robot.tree_f, span, body[new:], spheres[new:, :3])
    reach = np.concatenate([robot.sphere_reach[stays], reach])
    return replace(
        robot, spheres=spheres, sphere_body=body, sphere_link=link, sphere_reach=reach
    )


def outer_bodies(robot: Robot) -> set[int]:
    """Return the tool's body and what hangs on it; its ancestors while it is bare."""
    top = int(robot.tip_body)
    while top > 0:
        below = hanging_on(robot, top)
        links = np.flatnonzero(np.isin(robot.link_body, list(below)))
        if np.isin(robot.solid_link, links).any():
            return below
        top = int(robot.tree_i[top, PARENT])
    return set()


class FineTest:
    """The four tests' scenery and frame parts with the fine cover."""

    def __init__(self, frame: Frame) -> None:
        """Cover the outermost links; takes seconds the first time."""
        self.frame = frame
        self.robot = fine_robot(frame.robot)
        thing = frame.thing
        if thing is not None:
            self.robot = with_payload(self.robot, thing.spheres, thing.shell, [])
        cell_map = frame.cell_map
        self.static = StaticTest(
            self.robot, frame.static.scenery, cell_map.safety, cell_map.grid, threads=1
        )
        self.static.set_extra(frame.extra)
        self.arm, self.work = self.static.arm, self.static.new_work()
        self.balls = self.arm.spheres[:, 3] + cell_map.safety.m + frame.extra
        self.radii = np.zeros(len(self.balls))
        self._sampled: object = self
        self._place: object = None

    def follow(self) -> None:
        """Take over the frame's scenery of the place and how points are sampled."""
        frame = self.frame
        if self._place is not frame.static.place:
            self._place = frame.static.place
            self.static.set_place(self._place)
        if self._sampled != frame.sampled:
            self._sampled = frame.sampled
            self.radii[:] = [ball + frame.covering(ball) for ball in self.balls]

    def cover(self) -> Cover:
        """Return the spheres for `LastPhase`."""
        links = self.static.sphere_links
        return Cover(self.arm, self.radii, links, self.work, self.balls)

    @property
    def close_test(self) -> CloseTest:
        """The close test of motions with the fine cover."""
        tolerance = self.frame.cell_map.motion_tolerance
        return CloseTest(self.arm, self.radii, tolerance, self.work, self.balls)

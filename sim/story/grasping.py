"""Where the robot grasps an object that somebody holds out, found a little a frame."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from handover.meet.held_object import HeldObject
from handover.targets.node_index import NodeIndex
from odm.checks import OBJECT
from odm.close_test.static import StaticTest
from odm.frame.freedom import check_valid
from odm.frame.last_phase import GRIPPER_KEEPS, gripper_links
from odm.obstacles.obstacles import Obstacles
from odm.obstacles.shapes import Box, Shape
from odm.planner.planner import ReactivePlanner
from roadmap.errors import BadConfiguration, BadInput
from roadmap.geometry.gaps import ball_gaps, moved_rods
from roadmap.kinematics.forward import cover_balls, tool_pose
from roadmap.robot.robot import Robot
from roadmap.transforms import pose_with, rotation_rpy
from sim.story.settings import GraspingSettings

_GRASPING = GraspingSettings()


@dataclass(frozen=True, eq=False)
class Reach:
    """A configuration at an object, and one straight before it.

    Attributes:
        q: (dof,) at the object [rad or m].
        q_before: (dof,) `back` or more before it, along the tool's z.
        T_tool_object: (4, 4) how the object is held there.
        grasp: Which of the grasps that is.
        room: How much more than the clearance the cover keeps from the object at
            `q_before` [m].
    """

    q: np.ndarray
    q_before: np.ndarray
    T_tool_object: np.ndarray
    grasp: int = 0
    room: float = np.inf


def quarter_turns(T_tool_object: np.ndarray, n: int = 4) -> np.ndarray:
    """Return a grasp in n turns about the tool's z, by quarters for 4, (n, 4, 4)."""
    turns = [rotation_rpy(0.0, 0.0, 2.0 / n * np.pi * k) for k in range(n)]
    return np.array([pose_with(R) @ T_tool_object for R in turns])


def box_of(obj: HeldObject) -> Shape:
    """Return a box that holds an object's capsules, in its frame."""
    ends = np.vstack([obj.capsules[:, :3], obj.capsules[:, 3:6]])
    radii = np.tile(obj.capsules[:, 6], 2)[:, None]
    low, high = (ends - radii).min(axis=0), (ends + radii).max(axis=0)
    return Box(high - low, pose_with(np.eye(3), 0.5 * (low + high)))


def straight_back(
    planner: ReactivePlanner,
    T_base_tool: np.ndarray,
    q: np.ndarray,
    back: float,
    settings: GraspingSettings = _GRASPING,
) -> np.ndarray | None:
    """Return (dof,) with the tool `back` [m] behind a pose, near q; None: none."""
    T = np.array(T_base_tool)
    T[:3, 3] -= back * T[:3, 2]
    for found in _ik(planner, T, q, settings):
        if np.abs(planner.frame.difference(q, found)).max() <= settings.straight:
            if is_valid(planner, found):
                return found
    return None


def is_valid(planner: ReactivePlanner, q: np.ndarray, bare: bool = False) -> bool:
    """Whether q can be a goal at all; `bare`: with nothing in the hand."""
    try:
        check_valid(planner.carrier.bare if bare else planner.static, q, "it")
    except BadConfiguration:
        return False
    return True


class TooNear(NamedTuple):
    """A link that is too near to an object in the hand, however it is grasped."""

    link: str
    gap: float  # [m] of its cover from the object
    keeps: float  # [m] it must keep: the pads alone may touch the object


def too_near(
    planner: ReactivePlanner,
    grasps: np.ndarray,
    capsules: np.ndarray,
    nodes: np.ndarray,
    spare: float = 0.0,
) -> TooNear | None:
    """Return a link that is too near to an object, however it is grasped, or None.

    Args:
        planner: Its finger pads may touch the object. The rest of the hand keeps 1 cm,
            the arm its clearance.
        grasps: (n, 4, 4) T_tool_object of the grasps that will do.
        capsules: (k, 7) the object's, object frame [m].
        nodes: (n, dof) where the arm is looked at [rad or m].
        spare: More distance that is asked for [m].
    """
    robot, links = planner.robot, planner.cover().links
    own, pads = gripper_links(robot), planner.settings.finger_pads
    middle = 0.5 * (robot.lower + robot.upper)  # wherever it is: the hand is the same
    for part, keeps, where in (
        ([n in own and n not in pads for n in links], GRIPPER_KEEPS, middle[None]),
        (
            [n not in own for n in links],
            _arm_keeps(planner),
            nodes[: _GRASPING.looked_at],
        ),
    ):
        which, keeps = np.flatnonzero(part), keeps + spare
        gap, ball = _most_room(robot, which, grasps, capsules, where, keeps)
        if gap < keeps:
            return TooNear(links[ball], gap, keeps)
    return None


def has_room(
    planner: ReactivePlanner, thing: object, T_tool_object: np.ndarray
) -> bool:
    """Whether the map of a planner has room for an object so held, (4, 4) [m]."""
    try:
        planner.carrier.fitting(thing, T_tool_object)
    except BadInput:
        return False
    return True


def with_room(
    planner: ReactivePlanner, thing: object, grasps: np.ndarray
) -> np.ndarray:
    """Return those grasps (n, 4, 4) for which the planner's map has room.

    Raises:
        BadInput: For none of them; both sizes are named.
    """
    kept = [T for T in grasps if has_room(planner, thing, T)]
    if not kept:
        planner.carrier.fitting(thing, grasps[0])  # which says what it lacks
    return np.array(kept)


def check_grasps(
    planner: ReactivePlanner,
    grasps: np.ndarray,
    capsules: np.ndarray,
    nodes: np.ndarray,
) -> None:
    """Refuse an object that a link is too near to, by name; see `too_near`."""
    found = too_near(planner, grasps, capsules, nodes)
    if found is not None:
        raise BadInput(
            f"{found.link} is {1e3 * found.gap:.0f} mm from the object where it is "
            f"grasped, but must keep {1e3 * found.keeps:.0f} mm, since the pads alone "
            "may touch it; give a grasp T_tool_object that holds it farther out along "
            "the tool's z (HeldObject.held_by)"
        )


def held_farther_out(
    planner: ReactivePlanner,
    obj: HeldObject,
    nodes: np.ndarray,
    spare: float = 0.0,
) -> HeldObject:
    """Return an object as it is held, or farther out where a link is too near to it.

    Along the tool's z, by what hand and arm have to keep from it and `spare` [m]; as it
    is where `most_out` is too little. Planner and nodes as in `too_near`.
    """
    T = np.array(obj.T_tool_object)
    for _ in range(_GRASPING.out_steps):
        found = too_near(
            planner, quarter_turns(T, obj.turns), obj.capsules, nodes, spare
        )
        if found is None:
            return obj.held_by(T)
        T[2, 3] += found.keeps - found.gap + _GRASPING.more
        if T[2, 3] - obj.T_tool_object[2, 3] > _GRASPING.most_out:
            break
    return obj


def _arm_keeps(planner: ReactivePlanner) -> float:
    """Return what the arm keeps from an object in the last phase [m]."""
    return planner.cell_map.safety.m + planner.extra


def _most_room(
    robot: Robot,
    which: np.ndarray,
    grasps: np.ndarray,
    capsules: np.ndarray,
    nodes: np.ndarray,
    enough: float,
) -> tuple[float, int]:
    """Return what some balls keep from a grasped object [m], and the nearest of them.

    At the node and with the grasp that leave most; the first ones that leave `enough`.
    """
    best, nearest = -np.inf, -1
    if not len(which):
        return np.inf, nearest
    for q in nodes:
        balls = cover_balls(robot, q)[robot.moving][which]
        T = tool_pose(robot, q)
        for grasp in grasps:
            gaps = ball_gaps(balls, moved_rods(capsules, T @ grasp)).min(axis=1)
            k = int(gaps.argmin())
            if gaps[k] > best:
                best, nearest = float(gaps[k]), int(which[k])
            if best >= enough:
                return best, nearest
    return best, nearest


class Reaches:
    """Looks for configurations at an object, one start of the search a call.

    Args:
        planner: The planner; its scenery counts.
        index: Nodes of its roadmap by pose of the tool.
        grasps: (n, 4, 4) T_tool_object of the grasps that may be used.
        back: Distance before the object [m].
        thing: The object, made by `odm.carried_object`, if it is taken away from there:
            robot and scenery must leave room for it; None: it stays.
        rods: (k, 7) the object's capsules, object frame [m]; None: none to keep from.
        room: Distance beyond the clearance that the cover keeps from those before the
            object [m], since nearer to it the robot creeps. The way back is made longer
            for it; configurations without that room come last.
        on: Solid of the scenery that the object stands on, which it may touch on the
            straight way; None: nothing. It counts where there is a `thing`.
        settings: How hard.
        first: How many of the grasps come first; the others are tried where these lead
            nowhere. None: all.

    Attributes:
        found: What is known at the present pose.
    """

    def __init__(
        self,
        planner: ReactivePlanner,
        index: NodeIndex,
        grasps: np.ndarray,
        back: float,
        thing: object = None,
        rods: np.ndarray | None = None,
        room: float = 0.0,
        on: int | None = None,
        settings: GraspingSettings = _GRASPING,
        first: int | None = None,
    ) -> None:
        self.settings = settings
        self._first = len(grasps) if first is None else first
        self.planner, self.index, self.back = planner, index, back
        self._rods, self._room = rods, room
        self.T_tool_object = np.array(grasps)
        self._held: list[StaticTest] = []  # the robot with it, for each grasp
        if thing is not None and planner.attached is not None:
            self._held = [planner.static] * len(self.T_tool_object)
        elif thing is not None:
            made = planner.carrier.test_with
            self._held = [made(thing, grasp) for grasp in self.T_tool_object]
        self._on = on
        if on is not None:
            self._held = [test.beside(on) for test in self._held]
        self._T_object_tool = np.linalg.inv(self.T_tool_object)
        self.found: list[Reach] = []
        self._tight: list[Reach] = []  # those that lack room
        self._passed: list[Reach] = []  # those that somebody is in the way of
        self._queue: list[tuple[int, int | np.ndarray]] = []  # grasp; seed, or which
        self._starts = list(self._queue)  # all of them, for a shorter way back
        self._later = list(self._queue)  # of the grasps that come last
        self._share = 0  # which of the shares of the way back
        self._seeds = settings.seeds  # near nodes of each grasp, so far
        self._nodes: dict[int, np.ndarray] = {}
        self._T: np.ndarray | None = None

    @property
    def at(self) -> np.ndarray | None:
        """(3,) the object's place that `found` is for [m]."""
        return None if self._T is None else self._T[:3, 3]

    def begin(self, T_base_object: np.ndarray, q: np.ndarray) -> None:
        """Begin anew for an object that is elsewhere now; do one start.

        What was found may only have to be moved, so its configurations come first; then
        q (dof,), then near nodes.
        """
        near = [(r.grasp, r.q) for r in self.found[:2]]
        self._T, self.found, self._nodes = np.array(T_base_object), [], {}
        self._tight, self._passed = [], []
        all_, first = len(self._T_object_tool), self._first
        self._queue = self._starts_of(range(first), near, q)
        self._later = self._starts_of(range(first, all_), near, q)
        self._starts, self._share = list(self._queue), 0
        self._seeds = self.settings.seeds
        self.work()

    def outdate(self) -> None:
        """Let all be looked for anew: the object has left what they were found for."""
        self._T = None

    def first(self, T_base_object: np.ndarray, q: np.ndarray) -> list[Reach]:
        """Begin anew, and look until something is found or nothing is left."""
        self.begin(T_base_object, q)
        while not self.over and not self.found:
            self.work()
        return self.found

    def _starts_of(
        self, grasps: range, near: list[tuple[int, np.ndarray]], q: np.ndarray
    ) -> list[tuple[int, int | np.ndarray]]:
        """Return the starts for some grasps: found before, q (dof,), near nodes."""
        seeds = [(own, seed) for own, seed in near if own in grasps]
        seeds += [(g, seed) for own, seed in near for g in grasps if g != own]
        seeds += [(g, np.array(q)) for g in grasps]
        nodes = ((g, k) for k in range(self.settings.seeds) for g in grasps)
        return [*seeds, *nodes]

    def work(self) -> bool:
        """Do one start; return whether something new was found."""
        if self._T is None or self.over:
            return False
        g, k = self._queue.pop(0)
        found = self._start(g, k) or self._take_tight() or self._take_passed()
        if not self._queue and not self.found:
            self._go_on()
        return found

    def _go_on(self) -> None:
        """Queue what is left to try where nothing was found, if there is anything.

        A shorter way back, then the grasps that come last, then twice as many nodes.
        """
        if self._share + 1 < len(self.settings.shares):
            self._queue, self._share = list(self._starts), self._share + 1
        elif self._later:
            self._queue, self._later = self._later, []
        elif self._seeds < self.settings.most_seeds:
            before, most = self._seeds, self.settings.most_seeds
            self._seeds, self._nodes = min(2 * before, most), {}
            n = range(len(self._T_object_tool))
            self._queue = [(g, k) for k in range(before, self._seeds) for g in n]

    def _take_tight(self) -> bool:
        """Take those that lack room, once there are no others and will be none."""
        if self._queue or self.found or not self._tight:
            return False
        self._tight.sort(key=lambda reach: -reach.room)
        self.found, self._tight = self._tight[: self.settings.kept], []
        return True

    def pass_by(self) -> bool:
        """Look for others than those found: all are blocked; False: none are left.

        Once there are none, those found are what there is, again.
        """
        if not self._queue:
            return False
        self._passed, self.found = self._passed + self.found, []
        return True

    def _take_passed(self) -> bool:
        """Take those passed by again, once there are no others and will be none."""
        if self._queue or self.found or not self._passed:
            return False
        self.found, self._passed = self._passed, []
        return True

    def _start(self, g: int, k: int | np.ndarray) -> bool:
        """Begin at a configuration, or at the k-th of the nodes near a grasp."""
        if isinstance(k, np.ndarray):
            found = self._try(g, k)
            if found:  # the others would mostly find it again
                self._queue = [one for one in self._queue if isinstance(one[1], int)]
            return found
        if g not in self._nodes:
            T = self._T @ self._T_object_tool[g]
            self._nodes[g] = self.index.nearest(T, self._seeds)
        nodes = self._nodes[g]
        return k < len(nodes) and self._try(g, self.index.nodes[nodes[k]])

    @property
    def over(self) -> bool:
        """Whether all has been tried."""
        return not self._queue or len(self.found) >= self.settings.kept

    def drop(self, reach: Reach) -> None:
        """Leave one out: it is blocked."""
        self.found = [r for r in self.found if r is not reach]
        self._take_tight()
        if not (self._queue or self.found):
            self._go_on()

    def moved_to(self, reach: Reach, T_base_object: np.ndarray) -> np.ndarray | None:
        """Return (dof,) with the same grasp where the object is now, near the old."""
        T = T_base_object @ np.linalg.inv(reach.T_tool_object)
        for q in _ik(self.planner, T, reach.q, self.settings):
            if np.abs(self.planner.frame.difference(reach.q, q)).max() < 0.3:
                return q
        return None

    def _try(self, grasp: int, seed: np.ndarray) -> bool:
        planner = self.planner
        T = self._T @ self._T_object_tool[grasp]
        for q in _ik(planner, T, seed, self.settings):
            others = self.found + self._tight + self._passed
            known = [np.abs(planner.frame.difference(q, r.q)).max() for r in others]
            if min(known, default=1.0) < 0.1 or not is_valid(planner, q, bare=True):
                continue
            before, room = self._before(T, q)
            if before is None or not self._can_come(q, before):
                continue
            if self._can_leave(grasp, q, before):
                reach = Reach(q, before, self.T_tool_object[grasp], grasp, room)
                tight = room < self._room
                (self._tight if tight else self.found).append(reach)
                return not tight
        return False

    def _before(self, T: np.ndarray, q: np.ndarray) -> tuple[np.ndarray | None, float]:
        """Return (dof,) before a grasp at T (4, 4), and what room it has there [m].

        As far as it needs for its room; where no way is so long, with the most of it.
        """
        best, most = None, -np.inf
        far = self.back * self.settings.shares[self._share]
        for _ in range(self.settings.lengths):
            before = straight_back(self.planner, T, q, far, self.settings)
            if before is None:
                break
            room = self._room_at(before)
            if room > most:
                best, most = before, room
            if room >= self._room:
                break
            far += self._room - room + self.settings.more
        return best, most

    def _room_at(self, q: np.ndarray) -> float:
        """Return what the cover keeps from the object besides the clearance [m]."""
        if self._rods is None:
            return np.inf
        robot = self.planner.robot
        balls = cover_balls(robot, q)[robot.moving]
        gaps = ball_gaps(balls, moved_rods(self._rods, self._T))
        return float(gaps.min()) - self.planner.keep

    def _can_come(self, q: np.ndarray, before: np.ndarray) -> bool:
        """Whether the straight way to the object is free beside the object itself.

        By the rules of the last phase: pads may touch it, the rest of the hand keeps 1
        cm and the arm its clearance.
        """
        planner = self.planner
        if self._rods is None or planner.attached is not None:
            return True
        there = Obstacles(capsules=moved_rods(self._rods, self._T))
        there.shape_classes[:] = OBJECT
        way = np.array([before, before + planner.frame.difference(before, q)])
        return planner.blocked_leg(way, 0.0, there, "receive") is None

    def _can_leave(self, grasp: int, q: np.ndarray, before: np.ndarray) -> bool:
        """Whether the straight way back is free with the object in the hand."""
        if not self._held:
            return True
        planner, test = self.planner, self._held[grasp]
        bare, dq = planner.carrier.bare, planner.frame.difference(q, before)
        test.share_place(bare)
        # the hand is of one body with what it holds, and that may touch a solid
        if self._on is not None and not bare.motion_free(q, dq):
            return False
        return test.motion_free(q, dq)


def _ik(
    planner: ReactivePlanner,
    T: np.ndarray,
    seed: np.ndarray,
    settings: GraspingSettings,
) -> list[np.ndarray]:
    robot = planner.robot
    seed = np.clip(seed, robot.lower, robot.upper)
    found = robot.ik(
        T,
        seed,
        attempts=1,
        steps=settings.steps,
        position_tolerance=settings.tolerance,
        rotation_tolerance=settings.tolerance,
    )
    return [np.array(one.q) for one in found]

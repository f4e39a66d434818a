"""The robot's hand: what fits in it, and what it holds."""

from typing import NamedTuple

import numpy as np

from handover.meet.held_object import HeldObject
from odm.cell_map.payload import carried_object
from odm.execution.executor import Executor
from odm.frame import freedom
from odm.frame.last_phase import GRIPPER_KEEPS, gripper_links
from odm.obstacles.shapes import Box, Shape
from odm.planner.planner import ReactivePlanner
from roadmap.errors import BadInput
from roadmap.geometry.gaps import ball_gaps, moved_rods
from roadmap.kinematics.forward import cover_balls, tool_pose
from roadmap.robot.known import known_robot
from roadmap.robot.robot import Robot
from roadmap.transforms import pose_with, rotation_rpy
from sim.story.settings import GraspingSettings, StorySettings

OPEN, CLOSED = "open", "closed"
_ELSEWHERE = 0.03  # [m] covers of one object differ by less
_GRASPING = GraspingSettings()


class Hand:
    """The robot's hand, and the object that is in it or is to be.

    Args:
        planner: It has the object in its map while the hand holds it; its settings name
            the `finger_pads`.
        executor: Of the robot.
        obj: What is handed over.
        thing: Its solid, object frame; None: a box around its capsules.
        settings: Of the story; here: when an object is between the fingers.
        holding: Whether the object is in the hand at the beginning.

    Attributes:
        fingers: "open" or "closed": the command to the gripper.
        holding: Whether the object counts as being in the hand.
        doubted: Whether it does not, while the fingers stay closed and the map keeps
            it: they are said not to hold it, which may be the sensor's fault.
        T_tool_object: (4, 4) how it is held, or is to be [m].
        T_tool_between: (4, 4) how it was last between the open fingers [m].
        grasps: (n, 4, 4) T_tool_object of all ways to hold it [m].
        carried: Its solid, made by `odm.carried_object`.
        stands_at: (3,) where it stands for itself, base frame [m]; None: nowhere that
            is known.

    Raises:
        BadInput: No finger pads, an object that the robot is not made to carry, one in
            the hand that does not fit in where the robot stands, or one that the
            planner could not take into the map.
    """

    def __init__(
        self,
        planner: ReactivePlanner,
        executor: Executor,
        obj: HeldObject,
        thing: Shape | None,
        settings: StorySettings,
        holding: bool,
    ) -> None:
        _check_pads(planner)
        _check_mass(planner, obj)
        _check_carrier(planner, holding)
        self.planner, self.executor, self.obj = planner, executor, obj
        self.settings, self.holding, self.doubted = settings, holding, False
        self.fingers = CLOSED if holding else OPEN
        self.carried = carried_object(box_of(obj) if thing is None else thing)
        self.T_tool_object = self.T_tool_between = np.array(obj.T_tool_object)
        self.grasps = quarter_turns(obj.T_tool_object, obj.turns)
        self.stands_at: np.ndarray | None = None
        if holding and planner.attached is None:
            planner.attach(self.carried, self.T_tool_object)
            _check_room(planner, executor.set_point.q)
        elif holding:
            _check_held(planner, self.carried.moved(self.T_tool_object).spheres)

    def T_base_tool(self) -> np.ndarray:
        """Return (4, 4) where the tool is at the set-point [m]."""
        return tool_pose(self.planner.robot, self.executor.set_point.q)

    def T_base_held(self) -> np.ndarray:
        """Return (4, 4) where the object is while it is held, at the set-point [m]."""
        return self.T_base_tool() @ self.T_tool_object

    def capsules(self, T_base_object: np.ndarray | None) -> np.ndarray | None:
        """Return the object's capsules (k, 7), base frame [m]; None: it is not seen.

        `T_base_object` (4, 4) is where it is seen; it does not count while it is held.
        """
        T = T_base_object
        if self.holding:
            T = self.T_base_held()
        return None if T is None else moved_rods(self.obj.capsules, T)

    def take(self, T_tool_object: np.ndarray) -> None:
        """Have the object in the hand, so held (4, 4) [m], and in the map."""
        self.T_tool_object = T_tool_object
        self.planner.attach(self.carried, T_tool_object)
        self.holding, self.stands_at = True, None

    def let_go(self, puts_down: bool) -> None:
        """Have the object out of the hand; `puts_down`: it stands where it is now."""
        if puts_down:
            self.stands_at = self.T_base_held()[:3, 3]
        self.planner.detach()
        self.holding = self.doubted = False

    def doubt(self, doubted: bool = True) -> None:
        """Doubt that the object is in the closed fingers; False: it is, after all."""
        self.holding, self.doubted = not doubted, doubted

    def has(self, T_base_object: np.ndarray | None) -> bool:
        """Whether what is seen there (4, 4) [m] is what is in the hand, if anything."""
        if T_base_object is None or not self.doubted:
            return self.holding
        off = np.linalg.norm(self.T_base_held()[:3, 3] - T_base_object[:3, 3])
        return bool(off < self.settings.between)

    def is_between(self, T_base_object: np.ndarray | None) -> bool:
        """Whether an object is where a grasp would have it, while the robot stands.

        And its fingers are open.
        """
        stands = self.executor.at_rest and self.fingers == OPEN
        if T_base_object is None or self.holding or not stands:
            return False
        T_tool_object = np.linalg.inv(self.T_base_tool()) @ T_base_object
        s = self.settings
        for grasp in self.grasps:
            off = np.linalg.norm(grasp[:3, 3] - T_tool_object[:3, 3])
            if off < s.between and _turned(grasp, T_tool_object) < s.between_rad:
                # what could not be taken into the map, so held, is not closed on
                if not has_room(self.planner, self.carried, T_tool_object):
                    return False
                self.T_tool_between = T_tool_object
                return True
        return False


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


def is_valid(planner: ReactivePlanner, q: np.ndarray, bare: bool = False) -> bool:
    """Whether q can be a goal at all; `bare`: with nothing in the hand."""
    static = planner.carrier.bare if bare else planner.static
    return freedom.is_valid(static, q)


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
    planner: ReactivePlanner, obj: HeldObject, nodes: np.ndarray, spare: float = 0.0
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


def _check_pads(planner: ReactivePlanner) -> None:
    """Refuse a planner whose finger pads could not let go of anything."""
    pads, own = planner.settings.finger_pads, gripper_links(planner.robot)
    if not pads or not set(pads) <= own:
        raise BadInput(
            f"the planner's finger pads are {sorted(pads)}, but must be some of the "
            f"links that the tool carries: {', '.join(sorted(own))}; name those that "
            "touch an object in PlannerSettings(finger_pads=...)"
        )


def _check_mass(planner: ReactivePlanner, obj: HeldObject) -> None:
    """Refuse what a known robot is not made to carry."""
    known = known_robot(planner.cell_map.recipe.robot.source)
    most = None if known is None else known.payload_kg
    if most is not None and obj.mass_kg > most:
        raise BadInput(
            f"{obj.name} weighs {obj.mass_kg:g} kg, but {planner.robot.name} carries "
            f"{most:g} kg at most, its hand included, as its maker says; hand over "
            "something lighter, or give the object's true mass_kg"
        )


def _check_carrier(planner: ReactivePlanner, holds: bool) -> None:
    """Refuse a planner that could not take the object once the fingers close on it."""
    if not holds and planner.attached is not None:
        raise BadInput(
            f"the planner holds {len(planner.attached)} spheres, but this hand-over "
            "begins with an empty hand; call planner.detach() before"
        )
    if planner.cell_map.payload is None and not planner.settings.search:
        raise BadInput(
            f"map {planner.cell_map.recipe.name} has no payload layer, and search is 0 "
            "in the planner's settings, so nothing could be held; set search to 1000, "
            "or add a [payload] table to the recipe and build it again"
        )


def _check_held(planner: ReactivePlanner, spheres: np.ndarray) -> None:
    """Refuse an object (n, 4) that the planner holds elsewhere."""
    rows = planner.attached, spheres
    ends = [(r[:, :3] - r[:, 3:]).min(0) + (r[:, :3] + r[:, 3:]).max(0) for r in rows]
    off = 0.5 * float(np.linalg.norm(ends[0] - ends[1]))  # of the boxes around them
    if off > _ELSEWHERE:
        raise BadInput(
            f"the planner holds something {100 * off:.0f} cm from where T_tool_object "
            f"of the targets' object has it (limit {100 * _ELSEWHERE:.0f} cm); make "
            "them with obj.held_by(story.T_tool_object) of the story that took it, or "
            "call planner.detach() before"
        )


def _check_room(planner: ReactivePlanner, q: np.ndarray) -> None:
    """Refuse an object that cannot be held where the robot stands."""
    if not is_valid(planner, q, bare=True):
        return  # it is not the object's fault, and is told in each frame
    why = planner.static.why(q, np.zeros_like(q))
    if why is not None:
        planner.detach()
        raise BadInput(
            f"the object does not fit in where the robot stands: {why}; begin at "
            "another configuration, or give another grasp T_tool_object"
        )


def _turned(one: np.ndarray, other: np.ndarray) -> float:
    """Return the angle between two poses [rad]."""
    cosine = 0.5 * (np.trace(one[:3, :3].T @ other[:3, :3]) - 1.0)
    return float(np.arccos(min(1.0, max(-1.0, cosine))))

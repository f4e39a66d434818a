"""Who stands where in a hand-over, and whether it is in reach: told before the run."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path

import numpy as np

from handover import Human, InteractionWorkspace, MeetSettings, ReachMap
from handover.grasps.held_mesh import held_mesh
from handover.grasps.objects import GraspObject
from handover.meet.constraints import ClearOf
from handover.meet.held_object import HeldObject, wrench
from handover.meet.workspace import Target
from handover.targets.live_targets import LiveTargets
from handover.targets.node_index import NodeIndex
from handover.targets.put_down import carries
from handover.targets.settings import ChoiceSettings, LiveSettings
from odm import CellMap, PlannerSettings, ReactivePlanner
from odm.cell_map.payload import carried_object, require_fit
from odm.execution.settings import ExecutionSettings
from odm.execution.stop_test import OWN_LIMITS, slowest_stop
from odm.execution.threat import ThreatSettings
from odm.frame.last_phase import gripper_links
from odm.obstacles.shapes import Box
from roadmap.errors import BadInput
from roadmap.kinematics.forward import sphere_centers
from roadmap.ranges import CheckedSettings, setting
from roadmap.robot.known import known_robot
from roadmap.robot.robot import Robot
from roadmap.transforms import inverse_pose, pose_of
from sim.loop.loop import exact_audit
from sim.people.partner import PartnerTraits
from sim.people.whole_person import BASE_HEIGHT, FAR, LOOKED_AT, NEAR
from sim.run.meet import GRASPS
from sim.story.grasping import Reach, Reaches, straight_back
from sim.story.robot_hand import box_of, held_farther_out, is_valid, quarter_turns
from sim.story.settings import AT_PLACE, PARTNER, StorySettings

ASIDE = 60.0  # [deg] where people stand, at most
HEIGHTS = 1.5, 1.95  # [m]
JAW = 0.13  # [m] from the tool to the middle of the wrench: held by its jaw's tip
SPEED = 0.7  # share of the joints' speed limits that the robot uses
RATE = 100.0  # frames per second
# a hand-over waits by holding, and then at once
EXECUTION = ExecutionSettings(
    SPEED, yield_scale=SPEED, min_retreat_separation=0.005, hold_delay_s=0.0
)
_PADS = ("finger", "thumb", "pad")  # in the names of links that may touch an object
FINGERS = ("panda_leftfinger", "panda_rightfinger")
BACK = 0.10  # [m] straight motions to an object
_MOST_SPARE = 1.0  # [m] nobody hands over from farther away
# a slow robot's new paths keep so many times as much more from people as they come
# nearer while it stops, and no more than this [m]
_WIDER, _WIDEST = 4.0, 0.2
# where the wrench stands upright on the table, and what holds it there
PLACE_XY, HOLDER = (0.38, -0.42), (0.06, 0.06, 0.04)
_NEARER = (1.0, 0.8, 0.65, 0.5, 0.4)  # times that far, where a robot does not reach it
_OTHERS = (60.0, -60.0, 120.0, -120.0, 180.0)  # [deg] from it, where others are
_MOST_MOVED = 0.02  # [m] farther out, and the pads would not be where they hold it
_APART = 0.15  # [m] between two places
LIVE = LiveSettings(
    choice=ChoiceSettings(quality_hysteresis=0.1, max_quality_loss=0.3, goals=4),
    rank_budget=500,
    from_rest=True,
    spare_m=0.005,
)


@dataclass(frozen=True)
class StoryCase:
    """One run."""

    direction: str = "give"  # "give" or "receive"
    seed: int = 0  # of the traits' noise
    distance: float = 0.9  # of the person from the robot's base [m]
    bearing: float = 0.0  # seen from the robot [rad]
    height: float = 1.75  # of the person [m]
    # how the person behaves
    traits: PartnerTraits = field(default_factory=PartnerTraits)
    # of the robot's base above the floor of the person [m]
    base_height: float = BASE_HEIGHT

    @classmethod
    def drawn(cls, direction: str, seed: int) -> "StoryCase":
        """Return a case drawn over all places, heights and traits."""
        rng = np.random.default_rng([seed, direction == "give"])
        return cls(
            direction,
            seed,
            float(rng.uniform(NEAR, FAR)),
            float(np.radians(rng.uniform(-ASIDE, ASIDE))),
            float(rng.uniform(*HEIGHTS)),
            PartnerTraits.drawn(rng),
        )

    def body(self) -> Human:
        """Return the person, arms at rest, who faces the robot; base frame."""
        d, b = self.distance, self.bearing
        body = Human(self.height).placed(d * np.cos(b), d * np.sin(b), b + np.pi)
        return on_floor(body, self.base_height)


def on_floor(body: Human, base_height: float) -> Human:
    """Return a person who stands on their floor, not at the base's height, and looks.

    Args:
        body: The person, feet as high as the robot's base.
        base_height: Of the robot's base above the floor [m].
    """
    T = body.T_world_pelvis.copy()
    T[2, 3] -= base_height
    x, y, z = LOOKED_AT
    return body.moved(T).looking_at((x, y, z + BASE_HEIGHT - base_height))


def story_wrench() -> HeldObject:
    """Return the wrench, held by the very tip of its jaw: the palm keeps 1 cm off."""
    held = wrench()
    T = np.array(held.T_tool_object)
    T[2, 3] = JAW
    return held.held_by(T)


def upright(obj: HeldObject, xy: Sequence[float], table: float = 0.0) -> np.ndarray:
    """Return (4, 4) where a wrench stands upright in a holder at `xy`, base frame [m].

    `table` is how high it stands, base frame [m].
    """
    low = float((obj.capsules[:, [0, 3]] + obj.capsules[:, 6:7]).max())
    T = pose_of((*xy, table + low + 0.01), (0.0, 0.5 * np.pi, 0.0))
    return T  # the object's x, from jaw to handle, points down


def holder_at(T_place: np.ndarray, table: float = 0.0) -> Box:
    """Return the holder in which an object stands `upright` at T_place (4, 4)."""
    x, y = T_place[:2, 3]
    T = pose_of((x, y, table + 0.5 * HOLDER[2] + 0.002), (0.0, 0.0, 0.0))
    return Box(np.array(HOLDER), T)


@dataclass(frozen=True, eq=False)
class StorySetup:
    """What all runs share."""

    # the robot's map and its reach map
    cell_map: CellMap
    reach: ReachMap
    obj: HeldObject  # what is handed over
    index: NodeIndex  # roadmap nodes by pose of the tool
    rest: np.ndarray  # (dof,) where the robot begins and waits
    side: str = "right"  # the person's hand
    pads: tuple[str, ...] = FINGERS  # links that may touch an object
    # (4, 4) the object's place on the table; None: none
    T_place: np.ndarray | None = None
    # (n, 4, 4) other places on it, where it is put down when that one is not free
    T_others: np.ndarray = field(default_factory=lambda: np.zeros((0, 4, 4)))
    table: float = 0.0  # how high the table is, base frame [m]

    def places(self) -> np.ndarray | None:
        """Return (n, 4, 4) all places of the object, its own first; None: none."""
        if self.T_place is None:
            return None
        return np.concatenate([self.T_place[None], self.T_others])

    def planner(self) -> ReactivePlanner:
        """Return a planner that knows nothing yet, and what stands on the table."""
        settings = PlannerSettings(
            goal_connections=3,
            start_connections=3,
            confirmations=2,
            cached_goals=32,
            finger_pads=self.pads,
            history_clearance=_berth(self.cell_map.robot),
        )
        planner = ReactivePlanner(self.cell_map, settings=settings)
        if self.T_place is not None:
            planner.scene.add("holder", holder_at(self.T_place, self.table))
        return planner

    @property
    def clear(self) -> ClearOf:
        """What no arm and no object is in, or reaches through."""
        return ClearOf(self.cell_map.scenery)

    def meet(self, human: Human) -> InteractionWorkspace:
        """Return a workspace of its own."""
        settings = MeetSettings(side=self.side, constraints=(self.clear,))
        return InteractionWorkspace(self.reach, human, self.obj, GRASPS, settings)

    def targets(
        self,
        planner: ReactivePlanner,
        human: Human,
        threat: ThreatSettings | None = None,
    ) -> LiveTargets:
        """Return a live thread that knows nothing yet.

        `threat` is what is assumed of the person in the story; None: as by default.
        """
        comes = _comes(planner.robot, threat)[1]
        spare = min(max(LIVE.spare_m, comes), _MOST_SPARE)
        settings = replace(LIVE, spare_m=spare)
        args = self.meet(human), self.rest, self.index, settings
        return LiveTargets(planner, *args)


def _comes(robot: Robot, threat: ThreatSettings | None) -> tuple[float, float]:
    """Return how long the slowest stop takes [s], and how far somebody comes [m]."""
    return slowest_stop(robot, EXECUTION, 1.0 / RATE, threat or PARTNER)


def _berth(robot: Robot) -> float:
    """Return how much more than it must a new path keeps from people, if it can [m].

    A robot that is slow to stop creeps beside somebody near its path, until its
    patience ends; a quick one needs no more than by default.
    """
    usual, comes = PlannerSettings().history_clearance, _comes(robot, None)[1]
    if comes <= LIVE.spare_m:
        return usual
    return min(usual + _WIDER * comes, _WIDEST)


def grasp_spare(robot: Robot) -> float:
    """Return how much more a slow robot's links keep from what it takes [m].

    Beside an object that could come so far while it stops it would creep for as long as
    it is patient; a quick robot needs no more than the clearance.
    """
    comes = _comes(robot, None)[1]
    return comes if comes > LIVE.spare_m else 0.0


def slow_to_stop(robot: Robot, threat: ThreatSettings | None = None) -> str:
    """Return a sentence about a robot that takes long to stop; "": it does not.

    Args:
        robot: The robot.
        threat: What is assumed of the person in the story; None: as by default.
    """
    threat = threat or PARTNER
    time, comes = _comes(robot, threat)
    if comes <= LIVE.spare_m:
        return ""
    said = (
        f"{robot.name} takes {1e3 * time:.0f} ms to stop even from its slowest speed, "
        f"in which a person may come {1e2 * comes:.1f} cm nearer"
    )
    if threat.noise:
        said += f", as far as a sensor wrong by up to {1e3 * threat.noise:.0f} mm tells"
    said += ": closer to them it creeps; "
    if _comes(robot, replace(threat, noise=0.0))[1] <= LIVE.spare_m:
        return said + "with a better sensor (ThreatSettings(noise=...)) it goes nearer"
    return said + OWN_LIMITS


def rest_of(planner: ReactivePlanner, index: NodeIndex, obj: HeldObject) -> np.ndarray:
    """Return (dof,) a node at which the robot waits with the object in its hand.

    It is compact there: nothing of it, the object included, is far out to where people
    stand, and the joints are near the middles of their ranges. It is free with the
    object held by any of its grasps, since nobody knows how it is given back. The hand
    of the planner is empty.
    """
    robot = planner.robot
    thing = carried_object(box_of(obj))
    grasps = quarter_turns(obj.T_tool_object, obj.turns)
    held = [planner.carrier.test_with(thing, grasp) for grasp in grasps]
    loaded = held[0].robot
    middle, half = 0.5 * (robot.upper + robot.lower), 0.5 * (robot.upper - robot.lower)
    scores = []
    for q in index.nodes:
        centers = sphere_centers(loaded, q)
        far = np.linalg.norm(centers[:, :2], axis=1) + loaded.spheres[:, 3]
        out = far[centers[:, 0] > 0.0].max(initial=0.0)
        scores.append(out + 0.1 * float(np.linalg.norm((q - middle) / half)))
    still = np.zeros(robot.dof)
    for node in np.argsort(scores, kind="stable").tolist():
        q = np.array(index.nodes[node])
        if all(test.motion_free(q, still) for test in held):
            return q
    raise BadInput(
        f"map {planner.cell_map.recipe.name} has no node at which the robot is free "
        "with the object in its hand; give a map with more nodes, or another grasp"
    )


def place_in_reach(setup: StorySetup) -> np.ndarray | None:
    """Return (4, 4) where the object can stand and be grasped, base frame; or None.

    The usual place, or one nearer to the base, on either side of it.
    """
    obj, (x, y) = setup.obj, PLACE_XY
    thing = carried_object(box_of(obj))
    grasps = quarter_turns(obj.T_tool_object, obj.turns)
    room = StorySettings().room
    for side in (1.0, -1.0):
        for nearer in _NEARER:
            T = upright(obj, (nearer * x, side * nearer * y))
            planner = replace(setup, T_place=T).planner()
            beside = grasps, BACK, None, obj.capsules, room, None, AT_PLACE
            reaches = Reaches(planner, setup.index, *beside)
            found = reaches.first(T, setup.rest)
            if any(_is_clear(planner, thing, reach) for reach in found):
                return T
    return None


def _is_clear(planner: ReactivePlanner, thing: object, reach: Reach) -> bool:
    """Whether the object in the hand is clear of all before its place."""
    held = planner.carrier.test_with(thing, reach.T_tool_object)
    return held.motion_free(reach.q_before, np.zeros_like(reach.q_before))


def other_places(setup: StorySetup) -> np.ndarray:
    """Return (n, 4, 4) other places where the object can stand and be put down [m].

    Around the base, as high as its own place and on the same surface of the scenery:
    at most one in each direction, as far out as the own one or nearer. Held by some
    grasp the object comes straight down to it, clear of everything but that surface.
    """
    obj, scenery = setup.obj, setup.cell_map.scenery
    thing = carried_object(box_of(obj))
    grasps = quarter_turns(obj.T_tool_object, obj.turns)
    T_place, planner, found = setup.T_place, setup.planner(), []
    on = carries(scenery, obj.capsules, T_place)
    beside = grasps, BACK, thing, obj.capsules, StorySettings().room, on, AT_PLACE
    reaches = Reaches(planner, setup.index, *beside)
    for turn in np.radians(_OTHERS):
        for nearer in _NEARER:
            T = pose_of((0.0, 0.0, 0.0), (0.0, 0.0, turn)) @ T_place
            T[:2, 3] *= nearer
            near = [np.linalg.norm(T[:2, 3] - one[:2, 3]) for one in (T_place, *found)]
            if min(near) < _APART or carries(scenery, obj.capsules, T) != on:
                continue
            if reaches.first(T, setup.rest):
                found.append(T)
                break
    return np.array(found).reshape(-1, 4, 4)


def setup_of(
    cell_map: CellMap,
    reach: ReachMap,
    obj: HeldObject | None = None,
    place: bool = True,
    pads: Sequence[str] = (),
) -> StorySetup:
    """Return the setup of a map.

    Without an object it is a wrench, held as far out as hand and arm ask. With `place`
    it has its place on the table, if one is within reach. `pads` are links that may
    touch it; see `pads_of`. A map's payload envelope that is too small is left out.
    """
    robot = cell_map.robot
    pads = pads_of(robot, pads)
    index = NodeIndex(robot, cell_map.roadmap.nodes)
    if obj is None:
        planner = ReactivePlanner(cell_map, settings=PlannerSettings(finger_pads=pads))
        args = story_wrench(), index.nodes, grasp_spare(robot)
        obj = held_farther_out(planner, *args)
    cell_map = with_room_for(cell_map, obj)
    rest = rest_of(ReactivePlanner(cell_map), index, obj)
    setup = StorySetup(cell_map, reach, obj, index, rest, pads=pads)
    if place:
        setup = replace(setup, T_place=place_in_reach(setup))
    if setup.T_place is not None:
        setup = replace(setup, T_others=other_places(setup))
    return setup


def with_room_for(cell_map: CellMap, obj: HeldObject) -> CellMap:
    """Return a map in which an object can be held: its own envelope, or none at all.

    Without one the object counts by its own spheres, and ways with it in the hand are
    searched beyond the roadmap.
    """
    if cell_map.payload is None:
        return cell_map
    held = carried_object(box_of(obj)).moved(obj.T_tool_object)
    try:
        require_fit(cell_map.payload.recipe, held)
    except BadInput:
        return replace(cell_map, payload=None)
    return cell_map


def own_object(
    cell_map: CellMap, pads: Sequence[str], thing: GraspObject
) -> HeldObject:
    """Return an object of the user's as the robot of a map holds it.

    `thing` as of `handover.load_object`, `pads` as in `pads_of`. BadInput where the
    gripper cannot hold it, or nothing keeps clear of it.
    """
    robot, pads = cell_map.robot, pads_of(cell_map.robot, pads)
    obj = held_mesh(thing, robot, urdf_of(cell_map), robot.tip_name, pads)
    planner = ReactivePlanner(cell_map, settings=PlannerSettings(finger_pads=pads))
    moved = np.inf
    for spare in (grasp_spare(robot), LIVE.spare_m):  # a slow one creeps with less
        if moved > _MOST_MOVED:
            args = obj, cell_map.roadmap.nodes, max(spare, LIVE.spare_m)
            held = held_farther_out(planner, *args)
            moved = held.T_tool_object[2, 3] - obj.T_tool_object[2, 3]
    if moved > _MOST_MOVED:
        raise BadInput(
            f"{obj.name} would have to be held {100 * moved:.1f} cm farther out than "
            f"{robot.name}'s pads hold it, to keep clear of its other links (at most "
            f"{100 * _MOST_MOVED:.0f} cm); give a slimmer object, or longer fingers"
        )
    return held


def urdf_of(cell_map: CellMap) -> str:
    """Return the known name or the file that a map's gripper is read from.

    BadInput where the file is not there.
    """
    source = cell_map.recipe.robot.source
    if known_robot(source) is None and not Path(source).is_file():
        raise BadInput(
            f"the gripper that would hold the object is described in {source}, as map "
            f"{cell_map.recipe.name} names it, and from {Path.cwd()} that file is not "
            "found; change to the folder where this path starts, or build the map with "
            "the file's whole path"
        )
    return source


def pads_of(robot: Robot, names: Sequence[str] = ()) -> tuple[str, ...]:
    """Return the links that may touch an object, at least one that the tool carries.

    Without `names` those with "finger", "thumb" or "pad" in theirs.
    """
    carried = sorted(gripper_links(robot))
    likely = (n for n in robot.link_names if any(word in n.lower() for word in _PADS))
    pads = tuple(names or (n for n in likely if n in carried))
    if not pads:
        raise BadInput(
            f"{robot.name}'s tool carries no link with 'finger', 'thumb' or 'pad' in "
            "its name, so nothing could be grasped; say which may touch an object with "
            f"`--pads LINK`, of {', '.join(carried)}"
        )
    for name in names:
        if name not in carried:
            raise BadInput(
                f"--pads {name}: {robot.name}'s tool carries no such link; choose from "
                f"{', '.join(carried)}"
            )
    return pads


@dataclass(frozen=True)
class InReachSettings(CheckedSettings):
    """How hard it is looked whether a hand-over is in reach (`in_reach`).

    Attributes:
        ranked: Targets that are ranked,
        tried: ... and how many are tried at most, best first, of those where the map
            has a node's tool near.
        starts: Starts of the inverse kinematics for each,
        steps: ... and their steps.
        apart: In reach is what keeps so much from the person, exactly [m].
    """

    ranked: int = setting(400, 1, 10_000)
    tried: int = setting(40, 1, 10_000)
    starts: int = setting(8, 1, 10_000)
    steps: int = setting(60, 1, 10_000)
    apart: float = setting(0.02, 0.0, 1.0, "m")


@dataclass(frozen=True, eq=False)
class InReach:
    """A target that is in reach by exact geometry."""

    target: Target  # the target
    q: np.ndarray  # (dof,) the robot there [rad or m]


def in_reach(setup: StorySetup, case: StoryCase) -> InReach | None:
    """Return where the hand-over could be, by exact inverse kinematics; None: nowhere.

    The best targets are tried from many starts each. The robot must be within its
    limits, clear of itself and the scenery, and keep `apart` from the person whose arm
    is where it takes or offers the object, by the exact distance of solids. What it
    takes must leave the place straight back without touching the scenery.
    """
    body, settings = case.body(), InReachSettings()
    planner, meet = setup.planner(), setup.meet(body)
    audit = exact_audit(setup.cell_map.robot)
    grasps, held = [np.array(setup.obj.T_tool_object)], []
    if case.direction == "receive":
        grasps = list(quarter_turns(setup.obj.T_tool_object, setup.obj.turns))
        thing = carried_object(box_of(setup.obj))
        held = [planner.carrier.test_with(thing, grasp) for grasp in grasps]
    robot = setup.cell_map.robot
    scene = ClearOf.of_scene(planner, meet.settings.T_world_base)
    T_base_world = inverse_pose(meet.settings.T_world_base)
    targets = (
        target
        for target in meet.best_takeable(settings.ranked, scene)
        if not setup.index.is_remote(T_base_world @ target.T_world_tool, LIVE.far)
    )
    for target in islice(targets, settings.tried):
        there = body.with_arm(setup.side, target.arm_q).capsules()
        for k, grasp in enumerate(grasps):
            T = target.T_world_object @ np.linalg.inv(grasp)
            tries = dict(attempts=settings.starts, steps=settings.steps)
            for found in robot.ik(T, setup.rest, **tries):
                q = np.array(found.q)
                if not is_valid(planner, q) or audit(q, there) < settings.apart:
                    continue
                if case.direction == "receive":
                    before = straight_back(planner, T, q, BACK)
                    if before is None or audit(before, there) < settings.apart:
                        continue
                    dq = planner.frame.difference(q, before)
                    if not held[k].motion_free(q, dq):  # the object would not pass
                        continue
                return InReach(target, q)
    return None

"""Algorithms 2 and 3 of [Huaman2014]: which arm, grasps and pose, best first.

The tuples of H are made in the order of the receiver's dexterity at the goal, so that
the first one is the one that the paper selects from all of them. Where the paper's
reduced set holds none, it is widened step by step; each tuple says which step it is of.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache, partial
from itertools import count, islice

import numpy as np

from handover.grasps.arm_reach import ArmReach, build_arm_reach
from handover.grasps.grasp_set import GraspSet
from handover.grasps.hand import make_hand
from handover.plans.limb import Limb
from handover.plans.mover import Mover
from handover.plans.paths import OutOfTime
from handover.plans.prune import Grasper, LazyGrasps
from handover.plans.settings import SOLVE, PlanSettings
from handover.scenes.scene import Scene
from roadmap.kinematics.joint_tree import PRISMATIC
from roadmap.transforms import moved_points, pose_with, rotation_about


@dataclass(frozen=True, eq=False)
class HandoverChoice:
    """One way to hand over: arms, grasps, pose and joints of both agents.

    The paper calls it a tuple of H.
    """

    # sides of the arms of giver and receiver
    arm: str
    arm_receiver: str
    # numbers in the sets
    grasp_giver: int
    grasp_receiver: int
    T_world_handover: np.ndarray  # (4, 4) the object then [m]
    # (dof,) giver's arm and hand at the start and then
    q_start: np.ndarray
    q_giver: np.ndarray
    # (dof,) receiver's then and at the goal
    q_receiver: np.ndarray
    q_goal: np.ndarray
    dexterity: float  # the receiver's at the goal: what is selected by
    dexterity_giver: float  # the giver's at the hand-over: what decides among equals
    step: str  # which step of the search found it


@dataclass(eq=False)
class Report:
    """What was pruned where, and why."""

    arm: str = ""  # why the giver's arm was chosen
    # where -> the grasps looked at there, tested as far as was needed
    looked: dict[str, LazyGrasps] = field(default_factory=dict)
    # hand-over poses looked at, and those that the receiver can take
    poses: list = field(default_factory=lambda: [0, 0])
    tuples: int = 0  # tuples of H that were found
    step: str = ""  # which step of the search found the plan's tuple
    # motions that were not found, one line for each tuple tried
    failed: list = field(default_factory=list)
    refused: list[HandoverChoice] = field(default_factory=list)  # these tuples
    # grasps of the giver that it cannot come to, or lift, at the start, whatever
    # follows: no more tuples are made of them
    unpickable: set[int] = field(default_factory=set)
    # the same of the receiver at the goal
    unplaceable: set[int] = field(default_factory=set)
    # stage -> time spent [s]; no part of a plan's bytes
    seconds: dict = field(default_factory=dict)

    @property
    def grasps(self) -> dict[str, tuple[int, int, dict[str, int]]]:
        """Where -> (of how many, how many are left, why the others are not).

        Planning tests no more grasps than it needs; the others are tested here.
        """
        left = {where: (len(some), some.all()) for where, some in self.looked.items()}
        return {where: (n, len(e), e.refused) for where, (n, e) in left.items()}


@dataclass(frozen=True, eq=False)
class Pair:
    """A giver's arm and a receiver's arm, ready to move."""

    giver: Mover
    receiver: Mover
    of_giver: GraspSet
    of_receiver: GraspSet


@lru_cache(maxsize=16)
def reach_of(limb: Limb) -> ArmReach:
    """Return an arm's average manipulability by voxel, frame of its mount."""
    center = (0.0, 0.0, 0.5 * make_hand(limb.spec).reach)
    how = limb.side, center, SOLVE.samples, SOLVE.cell
    return build_arm_reach(limb.chain, *how)


def arms_in_order(
    limbs: dict[str, Limb],
    mounts: dict[str, np.ndarray],
    point: np.ndarray,
    size: float,
) -> tuple[list[str], str]:
    """Return the arms that reach a thing, the best first, and why (section IV-A).

    `mounts` are what they hang on, `point` (3,) the thing's middle, world frame [m]. An
    arm that only comes within `size` of the middle [m] is taken after those that reach
    it.
    """
    entries, local_points = {}, {}
    for side, limb in limbs.items():
        local = np.linalg.inv(mounts[side]) @ np.r_[point, 1.0]
        entries[side] = reach_of(limb).at(local[:3])
        local_points[side] = local[:3]
    able = sorted((s for s in entries if entries[s] > 0.0), key=lambda s: -entries[s])
    unable = [s for s in limbs if s not in able]
    near = {s: reach_of(limbs[s]).gap(local_points[s]) for s in unable}
    late = sorted((s for s in near if near[s] <= size), key=near.__getitem__)
    place = "(" + ", ".join(f"{x:.2f}" for x in point) + ") m"
    if not able and not late:
        best = min(near, key=near.__getitem__)
        return [], (
            f"no arm reaches {place}; the {best} one comes within {near[best]:.2f} m"
        )
    if not able:
        return late, (
            f"no arm reaches {place}; the {late[0]} one comes within "
            f"{near[late[0]]:.2f} m, which is less than the thing is long"
        )
    told = ", ".join(f"{s} {entries[s]:.3g}" for s in able)
    only = "only " if len(able) == 1 else ""
    text = f"{only}the {able[0]} arm: manipulability at {place} {told}"
    return able + late, text


def tuples(
    scene: Scene,
    pair: Pair,
    settings: PlanSettings,
    report: Report,
    late: Callable[[], bool] = lambda: False,
) -> Iterator[HandoverChoice]:
    """Yield the tuples of H, the receiver's most dexterous first, then wider ones.

    Within a step all tuples of one grasp of the receiver come before those of the next,
    less dexterous one, whatever their poses; those of a pose by the giver's dexterity.
    Nothing is tested before its turn. `late` is asked before each pose: of arms without
    a closed form one takes up to a second, and thousands may hold no tuple.

    Raises:
        OutOfTime: `late` says so.
    """
    giver, receiver = pair.giver, pair.receiver
    sides = giver.limb.side, receiver.limb.side
    giving, taking = Grasper(giver, pair.of_giver), Grasper(receiver, pair.of_receiver)
    waits = {
        "giver": scene.giver.values(giver.limb.joints),
        "receiver": scene.receiver.values(receiver.limb.joints),
    }
    looked = _at_goal(scene, taking, waits["giver"])
    report.looked[f"receiver {sides[1]}, goal"] = looked
    goals = Kept(iter(looked))
    if not goals.first(1):
        return
    starts = _at_start(scene, giving, waits["receiver"])
    report.looked[f"giver {sides[0]}, start"] = starts
    every, clashes = np.arange(len(pair.of_giver)), {}
    for step, places, turns in steps_of(pair, settings):
        for found in goals:
            clash = clashes.setdefault(found[0], np.zeros(len(every), bool))
            T_palm_object = np.linalg.inv(pair.of_receiver.T_object_palm[found[0]])
            for T in handover_poses(scene, pair, found[0], places, turns):
                if found[0] in report.unplaceable:
                    break
                use = starts.possible()
                use[list(report.unpickable)] = False
                if not use.any():
                    return
                if late():
                    raise OutOfTime("the choice of grasps and pose")
                report.poses[0] += 1
                hold = partial(receiver.carry, waits["giver"], T_palm_object)
                q_receiver = _taken(taking, found[0], T, hold)
                if q_receiver is None:
                    continue
                report.poses[1] += 1
                stand = partial(giver.stand, q_receiver, T, touching=True)
                for g, q_start, q, value in _given(
                    giving.look(T, np.flatnonzero(use & ~clash), stand, True, False),
                    starts, clash, report.unpickable,
                ):  # fmt: skip
                    yield HandoverChoice(
                        *sides, g, found[0], T, q_start, q, q_receiver, found[1],
                        found[2], value, step,
                    )  # fmt: skip


class Kept:
    """What an iterator yields, made as it is asked for; it can be gone through again.

    Args:
        every: The iterator; what it raises is raised where the next one is asked for.
    """

    def __init__(self, every: Iterator) -> None:
        self._rest, self._found = every, []

    def first(self, n: int) -> list:
        """Return n of them, or all that there are."""
        self._found += islice(self._rest, max(0, n - len(self._found)))
        return self._found[:n]

    def __iter__(self) -> Iterator:
        for k in count():
            if len(self.first(k + 1)) <= k:
                return
            yield self._found[k]


def _at_goal(scene: Scene, taking: Grasper, giver: np.ndarray) -> LazyGrasps:
    """Look at all grasps of the receiver at the goal; the giver's joints (dof,)."""
    stand = partial(taking.mover.stand, giver, scene.T_world_goal, touching=True)
    return taking.look(scene.T_world_goal, np.arange(len(taking.grasps)), stand)


def _at_start(scene: Scene, giving: Grasper, receiver: np.ndarray) -> LazyGrasps:
    """Look at all grasps of the giver at the start; the receiver's joints (dof,)."""
    stand = partial(giving.mover.stand, receiver, scene.T_world_start, touching=True)
    every = np.arange(len(giving.grasps))
    return giving.look(scene.T_world_start, every, stand, hands=True, rated=False)


def steps_of(pair: Pair, settings: PlanSettings) -> Iterator[tuple]:
    """Yield (name, places, turns) of each step: the paper's first, then wider."""
    places = common_voxels(pair, settings.near)
    if len(places):
        first, rest = places[:1], places[1 : settings.voxels]
        more = 2.0 * np.pi * np.arange(1, settings.turns) / settings.turns
        yield "the paper's reduced set", first, [0.0]
        yield "more voxels", rest, [0.0]
        yield "more rotations", places[: max(1, settings.voxels // 4)], more.tolist()
        yield "more rotations, more voxels", rest, more.tolist()


def common_voxels(pair: Pair, near: float) -> np.ndarray:
    """Return the voxels that both arms reach (n, 3), the most dexterous first.

    They are neighbours of the middle between the shoulders, nearer than `near` [m].
    """
    middle = 0.5 * np.add(*shoulders(pair))
    n = int(np.ceil(near / SOLVE.cell))
    steps = np.arange(-n, n + 1) * SOLVE.cell
    grid = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1)
    offsets = grid.reshape(-1, 3)
    offsets = offsets[np.linalg.norm(offsets, axis=1) <= near + 1e-9]
    points = middle + offsets
    value = np.ones(len(points))
    total = np.zeros(len(points))
    for mover in (pair.giver, pair.receiver):
        reach = reach_of(mover.limb)
        local = moved_points(points, np.linalg.inv(mover.T_mount))
        entry = reach.entries(local)
        value *= entry > 0.0
        total += entry / reach.average.max()
    able = np.flatnonzero(value > 0.0)
    order = able[np.argsort(-total[able], kind="stable")]
    return points[order]


def shoulders(pair: Pair) -> tuple[np.ndarray, np.ndarray]:
    """Return where both shoulders are, the giver's first, world frame (3,) [m].

    An arm that begins with a slide, as on a rail, slides to the other one.
    """
    receiver = _shoulder(pair.receiver, _shoulder(pair.giver))
    return _shoulder(pair.giver, receiver), receiver


def _shoulder(mover: Mover, toward: np.ndarray | None = None) -> np.ndarray:
    """Return an arm's shoulder (3,), slid as far as it can to a point `toward` (3,)."""
    limb, (R, at) = mover.limb, (mover.T_mount[:3, :3], mover.T_mount[:3, 3])
    local = limb.chain.fixed[0, 9:] if limb.seven is None else limb.seven.shoulder
    here = R @ local + at
    if toward is None or limb.tree_i[1, 2] != PRISMATIC:
        return here
    joint, row = limb.tree_i[1, 1], limb.tree_f[1]
    along = R @ row[:9].reshape(3, 3) @ row[12:15]
    ends = np.sort(row[15] * np.array([limb.lower[joint], limb.upper[joint]]) + row[16])
    return here + np.clip((toward - here) @ along, *ends) * along


def handover_poses(
    scene: Scene, pair: Pair, grasp: int, places: np.ndarray, turns: list[float]
) -> Iterator[np.ndarray]:
    """Yield T_world_handover of Algorithm 3, lines 8 to 13, at places (n, 3)."""
    T_object_palm = pair.of_receiver.T_object_palm[grasp]
    R_palm = scene.T_world_goal[:3, :3] @ T_object_palm[:3, :3]
    z = np.subtract(*shoulders(pair))
    z /= np.linalg.norm(z)
    least = min_rotation(R_palm[:, 2], z) @ R_palm @ T_object_palm[:3, :3].T
    turned = [rotation_about(z, turn) @ least for turn in turns]
    for place in places:
        for R in turned:
            yield pose_with(R, place - R @ pair.of_receiver.thing.center)


def min_rotation(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the least rotation (3, 3) from unit vector a to b."""
    v, c = np.cross(a, b), float(a @ b)
    if c < -1.0 + 1e-9:
        side = np.eye(3)[int(np.argmin(np.abs(a)))]
        axis = np.cross(a, side)
        axis /= np.linalg.norm(axis)
        return 2.0 * np.outer(axis, axis) - np.eye(3)
    K = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.eye(3) + K + K @ K / (1.0 + c)


def _taken(
    taking: Grasper, grasp: int, T: np.ndarray, hold: Callable[[], None]
) -> np.ndarray | None:
    """Return the receiver's joints that hold the object at a pose, None: none do."""
    found = next(iter(taking.look(T, np.array([grasp]), hold)), None)
    return None if found is None else found[1]


def _given(
    found: LazyGrasps, starts: LazyGrasps, clash: np.ndarray, without: set[int]
) -> Iterator[tuple[int, np.ndarray, np.ndarray, float]]:
    """Yield (grasp, joints at the start, joints, dexterity) of the giver, best first.

    The receiver holds the object, too. In `clash` grasps are marked at which both hands
    meet: wherever the object is, they will. `without` may grow meanwhile.
    """
    clash[found.clashing()] = True
    for g, q, value in found:
        q_start = None if g in without else starts.joints(g)
        if q_start is not None:
            yield g, q_start, q, value

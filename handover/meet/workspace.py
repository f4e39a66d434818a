"""InteractionWorkspace: where robot and person can meet, the most comfortable first.

[Vahrenkamp2016, III-C and Algorithm 1]; what a target is: `docs/workspace.md`.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import compress
from numbers import Integral
from typing import NamedTuple

import numpy as np

from handover.human.human import Human
from handover.meet import _meet as kernels
from handover.meet._meet_search import Entries, Search, begin, go_on
from handover.meet.constraints import ClearOf, allowed
from handover.meet.held_object import HeldObject, checked_grasps
from handover.meet.meet_tables import (
    PersonTables,
    bounds_of,
    hands_of,
    scratch,
    state_of,
    top_of,
)
from handover.meet.quality import ArmState, Quality
from handover.meet.settings import PARTS, MeetSettings
from handover.reach.reach_grid import ReachGrid
from handover.reach.reach_map import ReachMap
from handover.reach.robot_cells import RobotCells, robot_cells
from roadmap.arrays import frozen
from roadmap.errors import BadInput
from roadmap.ranges import check_kind, is_between, is_real, settings_of, told
from roadmap.transforms import flat_pose

_CHUNK = 20_000  # poses judged by the constraints in one go
MOST_RANKED = 100_000  # targets of one ranking


@dataclass(frozen=True, eq=False)
class Target:
    """A pose to hand an object over at.

    Attributes:
        T_world_tool: (4, 4) of the robot's tool [m], the centre of a cell.
        T_world_object: (4, 4) of the object [m].
        T_world_hand: (4, 4) of the person's hand [m].
        quality: q_total in [0, 1].
        parts: q_online and its five parts.
        dexterity: Of the person's hand pose, in [0, 1].
        arm_q: (7,) joints of the person's arm [rad].
        grasp: Number of the human grasp.
        key: Number of the cell; of equal quality the lower key comes first.
    """

    T_world_tool: np.ndarray
    T_world_object: np.ndarray
    T_world_hand: np.ndarray
    quality: float
    parts: Quality
    dexterity: float
    arm_q: np.ndarray
    grasp: int
    key: int


class _Pass(NamedTuple):
    """A ranking that has begun: positions in order, which is next, how many found."""

    task: Search
    order: np.ndarray
    at: int
    n: int


class InteractionWorkspace:
    """The cells of a robot's reach map in which a person can take what it holds."""

    def __init__(
        self,
        reach: ReachMap,
        human: Human,
        obj: HeldObject,
        grasps: Sequence | np.ndarray | int | None = None,
        settings: MeetSettings | None = None,
        human_reach: ReachMap | None = None,
    ) -> None:
        """Place robot, object and person.

        Args:
            reach: What the robot reaches, frame: its base.
            human: The person, world frame.
            obj: What the robot holds, and how.
            grasps: T_object_hand (n, 4, 4), or a number: the first so many of the
                object's; None: all of them.
            settings: Grid, arm, quality, constraints.
            human_reach: Reach map of a person's arm, for the dexterity; None: one of
                coarse cells, built once in a process (about 2 s).

        Raises:
            BadInput: No grasp, a grid finer than the map, a map of the wrong kind.
        """
        self.settings = settings_of(settings, MeetSettings)
        check_kind("reach", reach, ReachMap, "give what load_reach_map returns")
        check_kind("obj", obj, HeldObject, "give a HeldObject, such as wrench()")
        self.obj, self.reach = obj, reach
        self.grasps = _grasps(obj, grasps)
        s = self.settings
        cells = robot_cells(reach, s.cell, s.rotations, s.marked_share)
        self._cells = self._allowed(cells)
        self._keys = frozen(self._cells.keys(), np.int64)
        self._removed = np.zeros(len(self._cells), bool)
        self._entries = Entries(
            self._keys, self._removed, np.zeros(len(self._cells), bool)
        )
        self._tables = PersonTables(human_reach)
        self._tools = self._cells.grid.rotations.centers.reshape(-1, 9)
        R, p = s.T_world_base[:3, :3], s.T_world_base[:3, 3]
        self._turns_world = R @ self._cells.grid.rotations.centers
        self._points_world = self._cells.points @ R.T + p
        self._T_tool_hand = obj.T_tool_object @ self.grasps
        self._tool_hands = flat_pose(self._T_tool_hand)
        self._hands = hands_of(len(self._tools), self._tool_hands)
        self._scratch = scratch()
        self._bounds = bounds_of(len(self._cells.points), self._hands)
        self._turned = np.zeros(0)
        self.human: Human | None = None
        self._state: ArmState | None = None
        self._top = top_of(1)
        self._warm = np.zeros(0, np.int64)
        self._order = np.zeros(len(self._cells.points), np.int64)
        self._pass: _Pass | None = None
        self.update(human)

    def __len__(self) -> int:
        """Return how many targets there are; needs the full grid."""
        return int(((self.build() >= 0) & ~self._removed).sum())

    def update(self, human: Human) -> None:
        """Take another pose of the person: place, gaze, arms.

        A ranking that has begun is given up.
        """
        check_kind("human", human, Human, "give a handover.Human")
        s = self.settings
        self._give_up()
        state = state_of(human, s, self.human, self._state)
        arm, T = human.arm(s.side), human.T_world_shoulder(s.side)
        mirror = -1.0 if s.side == "left" else 1.0
        into = np.array([[1.0], [mirror], [1.0]]) * T[:3, :3].T
        turn = into @ s.T_world_base[:3, :3]
        points = self._cells.points @ turn.T
        points += into @ (s.T_world_base[:3, 3] - T[:3, 3])
        turned = np.append(turn.ravel(), arm.lengths)
        if not np.array_equal(turned, self._turned):
            kernels.fill_hands(
                turn,
                self._tools,
                self._tool_hands,
                mirror,
                float(arm.lengths[2]),
                self._tables.rotations.arrays,
                self._hands,
            )
            self._turned = turned
        person = self._tables.person(state, arm, s, float(self._hands.far[1]))
        cells = kernels.Cells(points, self._cells.first, self._cells.rotation)
        self._scene = kernels.Scene(person, self._hands, cells)
        self.human, self._state, self._value = human, state, None

    def expect(self, side: str) -> None:
        """Rank for the person's other arm from now on: "left" or "right".

        A ranking that has begun is given up.
        """
        self.settings = replace(self.settings, side=side)
        self._state = None
        self.update(self.human)

    def build(self) -> np.ndarray:
        """Solve every cell.

        Returns:
            (n,) quality of each cell the robot reaches; -1 where nobody can take the
            object. `keys` tells the cells.
        """
        if self._value is None:
            n = len(self._cells)
            value, grasp = np.empty(n), np.empty(n, np.int32)
            kernels.full_grid(self._scene, self._scratch, value, grasp)
            self._value = frozen(value, float)
        return self._value

    def best(self, k: int = 10) -> list[Target]:
        """Return the best k targets, best first; of equal quality the lower key.

        The same as the full grid's best k, found without solving it.
        """
        self.begin(k)
        self.go_on(math.inf)
        return self.ranked()

    def begin(self, k: int = 10) -> None:
        """Begin to look for the best k targets of the person as they are now.

        `go_on` leads it to its end, some work a frame, then `ranked` returns them. A
        ranking that was begun before is given up.
        """
        if not (is_between(k, 1, MOST_RANKED) and isinstance(k, Integral)):
            raise BadInput(
                f"the best {k} targets are none; give k from 1 to {MOST_RANKED}"
            )
        self._give_up()
        if len(self._top.value) != k:
            self._top = top_of(k)
        self._scratch.counts[:] = 0
        bounds = self._tables.bounds(self._scene.person, self._bounds)
        task = Search(self._scene, self._entries, bounds, self._top, self._scratch)
        n, m = begin(task, self._warm, self._order)
        self._pass = _Pass(task, self._order[:m], 0, n)

    def go_on(self, budget: float) -> bool:
        """Go on with a ranking; return whether it is over.

        Args:
            budget: Work at most, in hundreds of compared bytes; about 1 us each.

        Raises:
            BadInput: None was begun since the person was told last, or the budget is
                no number.
        """
        if not is_real(budget) or budget != budget:
            raise BadInput(f"a budget of {told(budget)} is none; give a number")
        task, order, at, n = self._pass_begun()
        at, n = go_on(task, order, at, n, float(budget))
        self._pass = _Pass(task, order, at, n)
        return at == len(order)

    def ranked(self) -> list[Target]:
        """Return the best of a ranking that is over, best first; it ends with that.

        Raises:
            BadInput: None was begun, or it is not over.
        """
        _, order, at, n = self._pass_begun()
        if at < len(order):
            raise BadInput("the ranking is not over; call go_on until it returns True")
        self._give_up()
        self._warm = self._top.entry[:n].copy()
        return self._targets(self._warm, self._top.grasp[:n])

    @property
    def is_ranking(self) -> bool:
        """Whether a ranking was begun and not fetched by `ranked` yet."""
        return self._pass is not None

    def _pass_begun(self) -> "_Pass":
        if self._pass is None:
            raise BadInput("no ranking was begun for this person; call begin first")
        return self._pass

    def _give_up(self) -> None:
        """Drop a ranking in progress."""
        if self._pass is not None:
            self._entries.seen[self._warm] = False
        self._pass = None

    def rated(self, keys: Sequence[int]) -> list[Target | None]:
        """Return the targets of some cells with their quality now, in order of `keys`.

        A target is None where the cell was removed or is none of this workspace, or
        where no person can take the object there.
        """
        at, value, grasp = self._rate(keys)
        good = np.flatnonzero(value >= 0)
        found = self._targets(at[good], grasp[good])
        rated: list[Target | None] = [None] * len(at)
        for k, target in zip(good.tolist(), found, strict=True):
            rated[k] = target
        return rated

    def quality_of(self, keys: Sequence[int]) -> np.ndarray:
        """Return (n,) quality of some cells now; -1 where `rated` would be None."""
        return self._rate(keys)[1]

    def takeable(
        self, targets: Sequence[Target], scene: ClearOf | None = None
    ) -> list[Target]:
        """Return those at which hand and forearm are not in what stands still.

        Bent as `Target.arm_q` says, and as far as a constraint tells of arms
        (`ClearOf`); others are all returned. With such a constraint neither they nor
        the object may be in what a `scene` adds (`ClearOf.of_scene`).

        Raises:
            BadInput: No list of targets, or a scene that is none.
        """
        if scene is not None:
            check_kind("scene", scene, ClearOf, "give ClearOf.of_scene(...) or None")
        kept, s = _as_targets(targets), self.settings
        still = [c for c in s.constraints if isinstance(c, ClearOf)]
        if still and scene is not None and len(scene.scenery.solids):
            still.append(scene)
            there = np.array([t.T_world_object for t in kept]).reshape(-1, 4, 4)
            kept = list(compress(kept, scene.allows(there, self.obj)))
        for constraint in still:
            if not kept:
                break
            bent = np.array([target.arm_q for target in kept])
            arms = self.human.arm_capsules(s.side, bent)[:, :2]
            kept = list(compress(kept, constraint.allows_arms(arms)))
        return kept

    def best_takeable(self, k: int = 10, scene: ClearOf | None = None) -> list[Target]:
        """Return the best k of those that are `takeable`, best first."""
        n = k
        while True:
            ranked = self.best(n)
            kept = self.takeable(ranked, scene)
            if len(kept) >= k or len(ranked) < n or n == MOST_RANKED:
                return kept[:k]
            n = min(2 * n, MOST_RANKED)

    def remove(self, target: Target) -> None:
        """Take a target out until `restore` [Vahrenkamp2016, Algorithm 2, line 9]."""
        self._removed[self._place_of(target)] = True

    def restore(self, targets: Sequence[Target] | None = None) -> None:
        """Bring removed targets back; None: all of them."""
        if targets is None:
            self._removed[:] = False
            return
        for at in [self._place_of(target) for target in _as_targets(targets)]:
            self._removed[at] = False

    def _place_of(self, target: Target) -> int:
        """Return which of the keys a target has."""
        check_kind("target", target, Target, "give one that best() returned")
        at = int(np.searchsorted(self._keys, target.key))
        if at == len(self._keys) or self._keys[at] != target.key:
            raise BadInput(
                f"no cell of this workspace has the key {target.key}; give targets "
                "that its own best() returned"
            )
        return at

    def forget(self) -> None:
        """Forget the last best targets, with which the next `best` would begin."""
        self._give_up()
        self._warm = self._warm[:0]

    @property
    def work(self) -> dict[str, int]:
        """What the last `best` did: positions opened, bytes, grips, poses solved."""
        names = "positions", "bytes", "grips", "solved"
        return dict(zip(names, self._scratch.counts.tolist(), strict=True))

    @property
    def removed(self) -> np.ndarray:
        """(m,) int64 keys that are taken out."""
        return self._keys[self._removed]

    @property
    def keys(self) -> np.ndarray:
        """(n,) int64 cells the robot reaches and the constraints allow, ascending."""
        return self._keys

    @property
    def grid(self) -> ReachGrid:
        """The grid that `keys` number the cells of, in the robot's base frame."""
        return self._cells.grid

    @property
    def missing_m(self) -> float:
        """How much nearer the person would have to come, at least [m].

        The least way of the shoulder after which some cell's wrist is at arm's length;
        0 where lengths do not stand in the way. Infinite without any cell.
        """
        if not len(self._cells):
            return np.inf
        # a wrist is no farther from the tool than the longest of them
        longest = float(np.linalg.norm(self._hands.wrist, axis=2).max())
        far = np.linalg.norm(self._scene.cells.points, axis=1)
        order = np.argsort(far, kind="stable")
        best, at, step = np.inf, 0, 1
        while at < len(order) and far[order[at]] - longest < best:
            best = min(best, self._nearest_wrist(order[at : at + step]))
            at, step = at + step, 2 * step
        return max(float(best - self._scene.person.scales[3]), 0.0)

    def _nearest_wrist(self, positions: np.ndarray) -> float:
        """Return how far from the shoulder a wrist is at some positions, at least."""
        first = self._cells.first
        cells = np.concatenate([np.arange(*first[p : p + 2]) for p in positions])
        where = np.repeat(positions, first[positions + 1] - first[positions])
        wrists = self._hands.wrist[self._cells.rotation[cells]]
        wrists += self._scene.cells.points[where][:, None]
        return float(np.linalg.norm(wrists, axis=2).min())

    def _rate(self, keys: Sequence[int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return entries, qualities (-1: none) and grasps of the cells `keys`."""
        keys = _checked_keys(keys)
        value, grasp = np.full(len(keys), -1.0), np.full(len(keys), -1, np.int32)
        if not len(self._keys):
            return np.zeros(len(keys), np.int64), value, grasp
        at = np.minimum(np.searchsorted(self._keys, keys), len(self._keys) - 1)
        kernels.best_grasps(self._scene, at, self._scratch, value, grasp)
        value[(self._keys[at] != keys) | self._removed[at]] = -1.0
        return at, value, grasp

    def _allowed(self, cells: RobotCells) -> RobotCells:
        """Drop the cells that a constraint forbids, whoever takes the object."""
        s = self.settings
        if not s.constraints:
            return cells
        keys, keep = cells.keys(), []
        for at in range(0, len(keys), _CHUNK):
            T_base_tool = cells.grid.centers(keys[at : at + _CHUNK])
            T = s.T_world_base @ T_base_tool @ self.obj.T_tool_object
            keep.append(allowed(s.constraints, T, self.obj))
        return cells.kept(np.concatenate(keep)) if keep else cells

    def _targets(self, entries: np.ndarray, grasps: np.ndarray) -> list[Target]:
        n = len(entries)
        out = kernels.Described(*(np.empty((n, k)) for k in (7, 5, 3)))
        grasps = np.asarray(grasps, np.int64)
        kernels.describe(self._scene, entries, grasps, self._scratch, out)
        keys = self._keys[entries]
        T_tool = np.zeros((n, 4, 4))
        at = np.searchsorted(self._cells.first, entries, side="right") - 1
        T_tool[:, :3, :3] = self._turns_world[self._cells.rotation[entries]]
        T_tool[:, :3, 3] = self._points_world[at]
        T_tool[:, 3, 3] = 1.0
        T_object = T_tool @ self.obj.T_tool_object
        T_hand = T_tool @ self._T_tool_hand[grasps]
        targets = []
        for i, (total, online, dexterity) in enumerate(out.numbers.tolist()):
            named = dict(zip(PARTS, out.parts[i].tolist(), strict=True))
            poses = T_tool[i], T_object[i], T_hand[i]
            quality = total, Quality(named, online), dexterity
            numbers_of = out.joints[i], int(grasps[i]), int(keys[i])
            targets.append(Target(*poses, *quality, *numbers_of))
        return targets


def _checked_keys(keys: Sequence[int] | np.ndarray) -> np.ndarray:
    try:
        array = np.asarray(keys)
    except (ValueError, TypeError, OverflowError):
        array = np.empty(0, object)  # rows of unequal length
    if array.dtype.kind not in "iu" and (array.size or array.dtype == object):
        raise BadInput(f"keys are {told(keys)}; give whole numbers, as Target.key")
    return array.astype(np.int64).reshape(-1)


def _as_targets(targets: Sequence[Target]) -> list[Target]:
    """Return targets as a list; refuse what is none of them."""
    several = "give a list of targets that best() returned"
    check_kind("targets", targets, Iterable, several)
    kept = list(targets)
    for target in kept:
        check_kind("a target", target, Target, several)
    return kept


def _grasps(obj: HeldObject, grasps: Sequence | np.ndarray | int | None) -> np.ndarray:
    if grasps is None:
        return obj.hand_grasps
    if isinstance(grasps, (int, np.integer)):
        if not 1 <= grasps <= len(obj.hand_grasps):
            raise BadInput(
                f"{obj.name} has {len(obj.hand_grasps)} human grasps; {grasps} of them "
                "cannot be taken: give 1 or more, or poses of your own"
            )
        return obj.hand_grasps[: int(grasps)]
    return checked_grasps(grasps)

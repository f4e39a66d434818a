"""InteractionWorkspace: where robot and person can meet, ranked by the person's comfort.

[Vahrenkamp2016, III-C and Algorithm 1]; what a target is: `docs/workspace.md`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from handover._kernels import meet as kernels
from handover._kernels.arm_ik import WORK_ROWS
from handover.arm import MIRROR
from handover.constraints import allowed
from handover.held_object import HeldObject, checked_grasps
from handover.human import Human
from handover.meet_settings import MeetSettings
from handover.quality import ArmState, Quality, posture_quality
from handover.reach_build import ReachSettings, build_reach_map
from handover.reach_map import ReachMap
from handover.robot_cells import RobotCells, robot_cells
from roadmap.arrays import frozen
from roadmap.errors import BadInput

_CHUNK = 20_000  # poses judged by the constraints in one go


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
        self.settings = settings or MeetSettings()
        self.obj, self.reach = obj, reach
        self.grasps = _grasps(obj, grasps)
        s = self.settings
        cells = robot_cells(reach, s.cell, s.rotations, s.marked_share)
        self._cells = self._allowed(cells)
        self._keys = frozen(self._cells.keys(), np.int64)
        self._removed = np.zeros(len(self._cells), bool)
        self._person_map = _PersonMap.of(human_reach or _coarse_human(human, s))
        self._room = kernels.Room(*(np.zeros(n) for n in ((WORK_ROWS, 3), 5, 7, 7, 12)))
        n_hands = len(s_tools := self._cells.grid.rotations.centers), len(self.grasps)
        self._tools = s_tools.reshape(-1, 9)
        self._hands = kernels.Hands(
            np.zeros((*n_hands, 12)),
            np.zeros((*n_hands, 3)),
            np.zeros(n_hands, np.int32),
        )
        T_tool_hand = obj.T_tool_object @ self.grasps
        self._tool_hands = np.concatenate(
            [T_tool_hand[:, :3, :3].reshape(-1, 9), T_tool_hand[:, :3, 3]], axis=1
        )
        self.update(human)

    def __len__(self) -> int:
        """Return how many targets there are; needs the full grid."""
        return int((self.build() >= 0).sum())

    def update(self, human: Human) -> None:
        """Let the person move, turn, look elsewhere or hold the arms differently."""
        s = self.settings
        self.human = human
        state = ArmState.of(human, s.side, s.quality, s.obstacles)
        arm = human.arm(s.side)
        flip = MIRROR if s.side == "left" else np.eye(3)
        T = human.T_world_shoulder(s.side)
        into = flip @ T[:3, :3].T
        turn = into @ s.T_world_base[:3, :3]
        points = self._cells.points @ turn.T
        points += into @ (s.T_world_base[:3, 3] - T[:3, 3])
        turns = self._person_map.rotations
        kernels.fill_hands(
            turn,
            self._tools,
            self._tool_hands,
            -1.0 if s.side == "left" else 1.0,
            arm.lengths[2],
            turns.n_side,
            turns.n_roll,
            turns.pixel_frames,
            self._hands,
        )
        self._person = kernels.Person(
            state.state,
            state.obstacles,
            state.settings,
            self._person_map.dexterity,
            self._person_map.box(arm.length),
            _scales(arm, s),
        )
        self._state = state
        self._where = kernels.Cells(
            points, self._cells.first, self._cells.rotation, self._removed
        )
        self._value: np.ndarray | None = None

    def build(self) -> np.ndarray:
        """Solve every cell.

        Returns:
            (n,) quality of each cell the robot reaches; -1 where nobody can take the
            object. `keys` tells the cells.
        """
        if self._value is None:
            n = len(self._cells)
            value, grasp = np.empty(n), np.empty(n, np.int32)
            kernels.full_grid(
                self._person, self._hands, self._where, self._room, value, grasp
            )
            self._value, self._grasp = value, grasp
        return self._value

    def best(self, k: int = 10) -> list[Target]:
        """Return the best k targets, best first; of equal quality the lower key."""
        if k < 1:
            raise BadInput(f"the best {k} targets are none; give k of 1 or more")
        value = np.where(self._removed, -1.0, self.build())
        order = np.lexsort((self._keys, -value))[:k]
        return [self._target(int(e), int(self._grasp[e])) for e in order if value[e] >= 0]

    def rated(self, keys: Sequence[int]) -> list[Target | None]:
        """Return what the targets of some cells are worth now, in the order of `keys`.

        None: removed, no cell of this workspace, or nobody can take the object there.
        """
        return [self._rated(int(key)) for key in keys]

    def _rated(self, key: int) -> Target | None:
        e = int(np.searchsorted(self._keys, key))
        if e == len(self._keys) or self._keys[e] != key or self._removed[e]:
            return None
        p = int(np.searchsorted(self._cells.first, e, side="right")) - 1
        r = int(self._cells.rotation[e])
        values = [
            kernels.hand_value(
                self._person, self._hands, r, g, *self._where.points[p], self._room
            )
            for g in range(len(self.grasps))
        ]
        g = int(np.argmax(values))
        return self._target(e, g) if values[g] >= 0 else None

    def remove(self, target: Target) -> None:
        """Take a target out until `restore` [Vahrenkamp2016, Algorithm 2, line 9]."""
        at = int(np.searchsorted(self._keys, target.key))
        if at == len(self._keys) or self._keys[at] != target.key:
            raise BadInput(
                f"no cell of this workspace has the key {target.key}; remove targets "
                "that its own best() returned"
            )
        self._removed[at] = True

    def restore(self) -> None:
        """Bring all removed targets back."""
        self._removed[:] = False

    @property
    def keys(self) -> np.ndarray:
        """(n,) int64 cells the robot reaches and the constraints allow, ascending."""
        return self._keys

    @property
    def missing_m(self) -> float:
        """How much nearer the person would have to come, at least [m].

        The least way of the shoulder after which some cell's wrist is at arm's length;
        0 where lengths do not stand in the way. Infinite without any cell.
        """
        if not len(self._cells):
            return np.inf
        rotations = np.repeat(
            np.arange(len(self._cells.points)), np.diff(self._cells.first)
        )
        best = np.inf
        high = self._person.scales[3]
        for g in range(len(self.grasps)):
            wrist = (
                self._where.points[rotations]
                + self._hands.wrist[self._cells.rotation, g]
            )
            best = min(best, np.linalg.norm(wrist, axis=1).min() - high)
        return max(float(best), 0.0)

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

    def _target(self, e: int, g: int) -> Target:
        p = int(np.searchsorted(self._cells.first, e, side="right")) - 1
        r = int(self._cells.rotation[e])
        x, y, z = self._where.points[p]
        value = kernels.hand_value(self._person, self._hands, r, g, x, y, z, self._room)
        q = self._room.best.copy()
        key = int(self._keys[e])
        T_tool = self.settings.T_world_base @ self._cells.grid.centers([key])[0]
        T_object = T_tool @ self.obj.T_tool_object
        T_hand = T_object @ self.grasps[g]
        parts = posture_quality(self._state, q)
        share = self.settings.quality.online_weight
        dexterity = (
            0.0 if share == 1.0 else (value - share * parts.online) / (1 - share)
        )
        return Target(T_tool, T_object, T_hand, value, parts, dexterity, q, g, key)


class _PersonMap:
    """The dexterity of a person's arm, cell by cell."""

    def __init__(self, dexterity: np.ndarray, reach: ReachMap) -> None:
        self.dexterity = frozen(dexterity, np.uint8)
        self.rotations = reach.grid.rotations
        self._grid = reach.grid

    @classmethod
    def of(cls, reach: ReachMap) -> "_PersonMap":
        if reach.chain.unit != "arm length":
            raise BadInput(
                f"human_reach is a map of {reach.chain.name} in {reach.chain.unit}; give "
                "one of a person's arm: `odm workspace build human`"
            )
        return cls(reach.dense(), reach)

    def box(self, length: float) -> np.ndarray:
        """Return corner, cell [m] and shape for an arm of that length [m]."""
        grid = self._grid
        return np.array([*(grid.origin * length), grid.cell * length, *grid.shape, 0.0])


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


def _scales(arm, s: MeetSettings) -> np.ndarray:  # noqa: ANN001
    upper, fore, _ = arm.lengths
    ends = [
        np.sqrt(upper**2 + fore**2 + 2 * upper * fore * np.cos(e))
        for e in arm.ranges[3]
    ]
    slack = 1e-6
    return np.array(
        [
            s.quality.online_weight,
            s.swivel_step,
            max(ends[1] - slack, 0.0),
            ends[0] + slack,
        ]
    )


def _coarse_human(human: Human, s: MeetSettings) -> ReachMap:
    return coarse_human_reach(
        tuple((human.arm(s.side).lengths / human.arm(s.side).length).round(6))
    )


@lru_cache(maxsize=4)
def coarse_human_reach(shares: tuple[float, ...] = ()) -> ReachMap:
    """Return a map of an arm of such shares of upper arm, forearm and hand."""
    arm = Human().arm("right")
    settings = ReachSettings(cell=0.1, rotations=72, samples=20_000)
    return build_reach_map(arm.chain(), settings, threads=1)

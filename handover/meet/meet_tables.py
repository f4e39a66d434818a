"""Tables of the search for a meeting place: of the person's map, and scratch."""

import hashlib
from functools import lru_cache

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from handover.human._arm_ik import WORK_ROWS
from handover.human.body import SIDES
from handover.human.human import Human
from handover.human.human_arm import Arm
from handover.meet import _meet as kernels
from handover.meet._meet_bounds import Bounds, fill_places
from handover.meet._meet_search import Top
from handover.meet._quality import DOWN, GAZE, HAS_GAZE
from handover.meet.quality import ArmState
from handover.meet.settings import MeetSettings
from handover.reach._reach_lookup import Packed
from handover.reach.reach_build import ReachSettings, build_reach_map
from handover.reach.reach_grid import reach_grid
from handover.reach.reach_map import ReachMap
from roadmap.arrays import frozen
from roadmap.builds.chunks import Arrays
from roadmap.builds.kept import code_of, kept
from roadmap.errors import BadInput
from roadmap.ranges import check_kind

_CODE = "handover/reach/reach_build.py"  # what takes part in a reach map
_SLACK = 1e-6  # [m] that the wrist's range is widened by; IK decides


class PersonTables:
    """The dexterity of a person's arm, cell by cell, for people of any height."""

    def __init__(self, reach: ReachMap | None) -> None:
        """Unpack a map; it must be of a person's arm. None: one of coarse cells."""
        reach = coarse_human_reach() if reach is None else reach
        remedy = "give one of a person's arm, or None"
        check_kind("human_reach", reach, ReachMap, remedy)
        if reach.chain.unit != "arm length":
            raise BadInput(
                f"human_reach is a map of {reach.chain.name} in {reach.chain.unit}; "
                "give one of a person's arm: `odm workspace build human`"
            )
        self.rotations = reach.grid.rotations
        self._grid = reach.grid
        self._dexterity = frozen(reach.dense(), np.uint8)
        self._ceiling = frozen(self._dexterity.max(axis=1), np.uint8)
        self._places = np.zeros((2, len(self._ceiling)))
        self._known = np.zeros(0)
        self._most: dict[int, np.ndarray] = {}

    def person(
        self, state: ArmState, arm: Arm, settings: MeetSettings, far_m: float
    ) -> kernels.Person:
        """Return what the kernels ask of a person whose grip is within `far_m` [m]."""
        grid, length = self._grid, arm.length
        cell = grid.cell * length
        margin = int(np.ceil(far_m / cell + 1e-9))
        box = [*(grid.origin * length), cell, *grid.shape, 1.0 / cell, margin]
        upper, fore, _ = arm.lengths
        square = upper**2 + fore**2 + 2 * upper * fore * np.cos(arm.ranges[3])
        high, low = np.sqrt(square)
        share = settings.quality.online_weight
        scales = [share, settings.swivel_step, max(low - _SLACK, 0.0), high + _SLACK]
        return kernels.Person(
            state.state,
            state.obstacles,
            state.settings,
            self._dexterity,
            np.array(box, float),
            self._ceiling,
            self._most_within(margin),
            np.array(scales, float),
        )

    def bounds(self, person: kernels.Person, scratch: Bounds) -> Bounds:
        """Return bounds by place of the grip, made anew where they do not hold."""
        known = np.concatenate(
            [person.state, person.settings, person.scales, person.box]
        )
        same = len(known) == len(self._known)
        if not same or np.abs(known - self._known).max() > 1e-9:
            fill_places(person, *self._places)
            self._known = known
        return scratch._replace(place_online=self._places[0], place=self._places[1])

    def _most_within(self, margin: int) -> np.ndarray:
        """Return the largest dexterity within so many cells, padded by as many."""
        if margin not in self._most:
            most = self._ceiling.reshape(self._grid.shape)
            most = np.pad(most, 2 * margin)
            for axis in range(most.ndim):
                most = sliding_window_view(most, 2 * margin + 1, axis).max(axis=-1)
            self._most = {margin: frozen(most, np.uint8)}
        return self._most[margin]


def state_of(
    human: Human,
    settings: MeetSettings,
    last: Human | None = None,
    known: ArmState | None = None,
) -> ArmState:
    """Return the state of the person's arm, from the last one if the body is alike.

    In the shoulder frame a body that only moved is the same; gaze and gravity are not.
    """
    s = settings
    if known is None or s.obstacles is not None or not _alike(human, last):
        return ArmState.of(human, s.side, s.quality, s.obstacles)
    R = human.T_world_chest[:3, :3]
    into = np.array([[1.0], [-1.0 if s.side == "left" else 1.0], [1.0]]) * R.T
    state = known.state.copy()
    gaze = R[:, 0] if human.gaze is None else human.gaze
    seen = human.gaze is not None or s.quality.absent_gaze == "torso"
    state[GAZE : GAZE + 3] = into @ gaze
    state[HAS_GAZE] = float(seen)
    state[DOWN : DOWN + 3] = -into[:, 2]
    return ArmState(s.side, state, known.obstacles, known.settings)


def _alike(human: Human, last: Human) -> bool:
    """Return whether two people differ in place, turn and gaze at most."""
    return (
        human.skeleton is last.skeleton
        and human.height == last.height
        and human.mass == last.mass
        and human.posture == last.posture
        and all(np.array_equal(human.arms[s], last.arms[s]) for s in SIDES)
        and np.array_equal(human.bend, last.bend)
    )


@lru_cache(maxsize=1)
def coarse_human_reach() -> ReachMap:
    """Return a reach map of a mean arm, of coarse cells, found once on a machine.

    In units of the arm's length: 0.1 of it and 60 degrees. The same each time; `kept`,
    since it takes a second to find.
    """
    settings = ReachSettings(cell=0.1, rotations=72, samples=20_000)
    chain = Human().arm("right").chain()

    def find() -> Arrays:
        reach = build_reach_map(chain, settings, threads=1)
        return (*reach.packed, np.array(reach.reference))

    name = hashlib.sha256(f"{code_of(_CODE)} {settings}".encode())
    for array in chain.arrays:
        name.update(array.tobytes())
    *packed, reference = kept("reach", name.hexdigest(), find)
    grid = reach_grid(chain, settings.cell, settings.rotations)
    return ReachMap(chain, grid, Packed(*packed), reference.item())


def hands_of(n_rotations: int, tool_hands: np.ndarray) -> kernels.Hands:
    """Return empty tables of hands for grasps T_tool_hand (g, 12)."""
    n = n_rotations, len(tool_hands)
    places = tool_hands[:, 9:]
    same = np.append(False, (places[1:] == places[:-1]).all(axis=1))
    cell = np.zeros(n, np.int32)
    return kernels.Hands(np.zeros((*n, 12)), np.zeros((*n, 3)), cell, np.zeros(2), same)


def scratch() -> kernels.Scratch:
    """Return scratch memory for the kernels."""
    sizes = (WORK_ROWS, 3), 5, 7, 7, 12
    return kernels.Scratch(*map(np.zeros, sizes), np.zeros(4, np.int64))


def bounds_of(n_positions: int, hands: kernels.Hands) -> Bounds:
    """Return memory for bounds."""
    n, by_hand = n_positions, hands.cell.shape
    return Bounds(*(np.zeros(k) for k in (n, n, 0, 0, 13, by_hand, by_hand)))


def top_of(k: int) -> Top:
    """Return an empty list of the best k."""
    kinds = (np.float64, np.int64, np.int64, np.int64)
    return Top(*(np.zeros(k, kind) for kind in kinds))

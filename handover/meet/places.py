"""What a person's hand can do at a place: the best over its rotations and elbows.

The map of one arm as in figure 3 of [Vahrenkamp2016], but at any places, with the
inverse kinematics and the qualities themselves instead of cells.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from handover.human._arm_ik import MAX_SPANS, WORK_ROWS
from handover.human.human import Human
from handover.human.human_arm import MIRROR, Arm
from handover.meet._places import COLUMNS, PlaceArm, PlaceScratch, best_at_places
from handover.meet._quality import HAS_GAZE
from handover.meet.quality import ArmState
from handover.meet.settings import PARTS, MeetSettings, QualitySettings
from handover.reach.extremes import best_dexterity, work_of
from handover.reach.rotations import rotation_grid
from roadmap.arrays import as_floats, freeze, frozen
from roadmap.errors import BadInput
from roadmap.ranges import settings_of

NAMES = (*PARTS, "dexterity", "combined", "online", "total")
_CHUNK = 64  # places between two looks at the progress


@dataclass(frozen=True, eq=False)
class PlaceQualities:
    """The best of a hand at n places, over all its rotations and elbows."""

    points: np.ndarray  # (n, 3) places of the grip, world frame [m]
    # name -> (n,) in [0, 1], NaN where the hand cannot be: the five parts of the
    # quality, each for itself; "dexterity" (1: the arm's best); "combined" (half
    # dexterity, half effort, of one posture); "online" (eq. 4); "total"
    best: dict[str, np.ndarray]
    q: np.ndarray  # (n, 7) joints of the best total [rad]; NaN where the hand cannot be
    reached: np.ndarray  # (n,) share of the rotations in which the hand can be there

    def __post_init__(self) -> None:
        freeze(self, points=float, q=float, reached=float)
        best = {k: frozen(v, np.float64) for k, v in self.best.items()}
        object.__setattr__(self, "best", best)


def qualities_at(
    human: Human,
    side: str,
    points: np.ndarray,
    settings: QualitySettings | None = None,
    *,
    rotations: int = 576,
    swivel_step: float = MeetSettings.swivel_step,
    obstacles: np.ndarray | None = None,
    progress: object = None,
) -> PlaceQualities:
    """Return how good a hand can be at places, over `rotations` even rotations.

    Elbows are tried `swivel_step` apart and at the ends of their intervals.

    Args:
        human: The person, as they are now.
        side: "left" or "right".
        points: (n, 3) places of the grip, world frame [m].
        settings: Of the quality; None: the defaults.
        rotations: How many of the hand are tried, see `rotation_grid`.
        swivel_step: See MeetSettings [rad].
        obstacles: (k, 7) capsules of the surroundings, world frame [m].
        progress: Called with ("places", done, n).

    Raises:
        BadInput: An unknown side, points that are no (n, 3) finite places.
    """
    points = as_floats("places", points)
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise BadInput(
            f"places have shape {points.shape}; give finite (n, 3) in metres"
        )
    settings = settings_of(settings, QualitySettings)
    state = ArmState.of(human, side, settings, obstacles)
    arm, T = human.arm(side), human.T_world_shoulder(side)
    flip = MIRROR if side == "left" else np.eye(3)
    local = (points - T[:3, 3]) @ T[:3, :3] @ flip
    turns = rotation_grid(rotations).centers.reshape(-1, 9)
    chain, reference = arm.chain(), _reference(tuple(arm.lengths / arm.length))
    shares = np.array([settings.online_weight, reference, swivel_step])
    room = 2 * MAX_SPANS + int(2.0 * math.pi / swivel_step) + 1
    given = state.state, state.obstacles, state.settings, chain.arrays, shares
    solved = np.empty((WORK_ROWS, 3)), np.empty((room, 7)), np.empty((room, 2))
    memory = PlaceScratch(work_of(chain), *solved)
    out, found = np.empty((len(points), COLUMNS)), np.empty((len(points), 9))
    for i in range(0, len(points), _CHUNK):
        part = slice(i, i + _CHUNK)
        best_at_places(
            PlaceArm(*given), turns, local[part], memory, out[part], found[part]
        )
        if progress:
            progress("places", min(i + _CHUNK, len(points)), len(points))
    nowhere = found[:, 8] == 0
    out[nowhere] = np.nan
    if state.state[HAS_GAZE] == 0.0:
        out[:, PARTS.index("visibility")] = np.nan
    q = np.where(nowhere[:, None], np.nan, found[:, :7])
    best = dict(zip(NAMES, out.T.copy(), strict=True))
    return PlaceQualities(points, best, q, found[:, 8] / len(turns))


@lru_cache(maxsize=16)
def _reference(shares: tuple[float, ...]) -> float:
    """Return the dexterity that is 1, for an arm of these shares of its length."""
    return best_dexterity(Arm("right", np.array(shares)).chain(), 1)

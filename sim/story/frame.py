"""What a hand-over sees and feels in one frame, checked where it is given."""

from dataclasses import dataclass
from numbers import Real

import numpy as np

from handover.human.human import Human
from roadmap.errors import BadInput
from roadmap.geometry.gaps import moved_rods
from roadmap.ranges import check_kind

_RIGID, _OFF_RIGID = 1e-9, 0.02  # a rotation off by more is mended; is none
_SHAPES = {"wrench": (6,), "T_base_object": (4, 4), "q": (-1,), "capsules": (-1, 7)}


@dataclass(frozen=True, eq=False)
class StoryFrame:
    """What is seen and felt in one frame.

    Capsules, a time or a q that are not finite are those of a failing sensor: the robot
    stops, says so, and goes on when they are finite again.

    Attributes:
        now: Time [s], of any clock.
        human: The person, world frame; where that is seen from the robot's base tells
            `MeetSettings.T_world_base`.
        wrench: (6,) at the robot's wrist [N], [N m]; None: no sensor, no pull.
        opened: Whether the fingers are open, as measured.
        holds: Whether there is something between closed fingers, as measured.
        T_base_object: (4, 4) where the object is seen [m]; None, or not finite: unseen.
        q: (dof,) measured configuration; None: at the set-point, or as far from it as
            when last measured.
        capsules: (k, 7) the person as the planner sees them, base frame [m]; None:
            those of `human`.
        labels: (k,) `handover.Part` of each; None: `human.labels`.

    Raises:
        BadInput: Another shape or kind, or not one label for each capsule.
    """

    now: float
    human: Human
    wrench: np.ndarray | None = None
    opened: bool = True
    holds: bool = False
    T_base_object: np.ndarray | None = None
    q: np.ndarray | None = None
    capsules: np.ndarray | None = None
    labels: np.ndarray | None = None

    def __post_init__(self) -> None:
        check_kind("now", self.now, Real, "give the time in seconds")
        nobody = "where nobody is seen, any with capsules=np.zeros((0, 7))"
        check_kind("human", self.human, Human, f"give a handover.Human; {nobody}")
        for name, shape in _SHAPES.items():
            if getattr(self, name) is not None:
                object.__setattr__(self, name, _numbers(name, self, shape))
        if self.T_base_object is not None:
            object.__setattr__(self, "T_base_object", _as_pose(self.T_base_object))
        parts = self.human.labels if self.labels is None else np.asarray(self.labels)
        if self.labels is not None:
            object.__setattr__(self, "labels", parts)
        rows = self.human.labels if self.capsules is None else self.capsules
        if self.capsules is not None or self.labels is not None:
            if parts.shape != (len(rows),):
                raise BadInput(
                    f"there are {len(rows)} capsules and {parts.size} labels, but each "
                    "capsule must have one; give both"
                )

    def person(
        self, T_base_world: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the capsules (k, 7) of the person, base frame [m], and labels (k,).

        `T_base_world` (4, 4) is the world's pose [m]; None: the base stands there.
        """
        rows, human = self.capsules, self.human
        if rows is None:
            rows = human.capsules()
            rows = rows if T_base_world is None else moved_rods(rows, T_base_world)
        return rows, human.labels if self.labels is None else self.labels


def _numbers(name: str, frame: StoryFrame, shape: tuple[int, ...]) -> np.ndarray:
    """Return what a frame has by a name as an array of a shape; -1: any length."""
    given = getattr(frame, name)
    try:
        numbers = np.asarray(given, float)
    except (TypeError, ValueError):
        numbers = np.zeros(())
    if len(shape) != numbers.ndim or any(
        n not in (-1, m) for n, m in zip(shape, numbers.shape, strict=True)
    ):
        shown = given if numbers.ndim == 0 else f"of shape {numbers.shape}"
        wanted = ", ".join("k" if n < 0 else str(n) for n in shape)
        raise BadInput(f"{name} is {shown!s:.40}, but must be numbers ({wanted})")
    return numbers


def _as_pose(T: np.ndarray) -> np.ndarray | None:
    """Return a measured pose (4, 4), exactly rigid; None where it is not finite."""
    if not np.isfinite(T).all():
        return None
    off = float(np.abs(T[:3, :3] @ T[:3, :3].T - np.eye(3)).max())
    wrong = off > _OFF_RIGID or (T[3] != (0.0, 0.0, 0.0, 1.0)).any()
    if wrong or np.linalg.det(T[:3, :3]) < 0.0:
        raise BadInput(
            f"T_base_object is no pose: its rotation is off by {off:.2g} (limit "
            f"{_OFF_RIGID:g}), its last row is {T[3].tolist()} and must be 0, 0, 0, 1, "
            "and mirroring is not allowed; give None where the object is not seen"
        )
    if off < _RIGID:
        return T
    u, _, v = np.linalg.svd(T[:3, :3])
    near = np.array(T)
    near[:3, :3] = u @ v
    return near

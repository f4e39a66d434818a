"""A person's motion seen from elsewhere: turned, then moved."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from roadmap.arrays import freeze
from roadmap.geometry.gaps import moved_rods
from roadmap.transforms import pose_of
from sim.people.human_motion import HumanMotion


@dataclass(frozen=True, eq=False)
class Placed:
    """A motion of a person who stands elsewhere; a HumanMotion."""

    motion: HumanMotion  # the motion as it was written
    yaw: float = 0.0  # by how much it is turned about the z axis of the base [rad]
    # (3,) how far it is moved then [m]
    offset: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        freeze(self, offset=float)

    @property
    def name(self) -> str:
        """Name of the motion."""
        return self.motion.name

    @property
    def max_speed(self) -> float:
        """No point of the surface advances faster than this [m/s]."""
        return self.motion.max_speed

    @property
    def period(self) -> float:
        """Time after which the motion repeats [s]; of a scripted one."""
        return self.motion.period

    @property
    def guess(self) -> Callable[[float], np.ndarray] | None:
        """Where the person is, not only might be, of motions that know it."""
        guess = getattr(self.motion, "guess", None)
        return None if guess is None else lambda t: self._moved(guess(t))

    def capsules(self, t: float) -> np.ndarray:
        """Return the person at time `t` [s] as (k, 7) capsules a, b, radius [m]."""
        return self._moved(self.motion.capsules(t))

    def _moved(self, capsules: np.ndarray) -> np.ndarray:
        return moved_rods(capsules, pose_of(self.offset, (0.0, 0.0, self.yaw)))

"""What tunes the search for grasps beside `GraspSettings`, which a set keeps."""

from dataclasses import dataclass, fields

from roadmap.ranges import check_settings


@dataclass(frozen=True)
class HoldSettings:
    """How closely a hand closes, and how hard it is looked whether it holds.

    Attributes:
        centred: Tries to put an object between the jaws of a gripper.
        each: Contacts kept of one link's patch: the nearest first, then the farthest
            off. Fewer withstand less, so what is told to hold, holds.
        directions: Pushes against which a grasp is tried before its hull is made.
        descent: Steps towards the weakest of them. More: fewer hulls are made in vain.
        drawn: Points of the surface drawn for each one that is kept. More: evener.
    """

    centred: int = 4
    each: int = 2
    directions: int = 512
    descent: int = 40
    drawn: int = 40

    def __post_init__(self) -> None:
        names = (one.name for one in fields(self))
        check_settings(self, dict.fromkeys(names, (1, 100_000, "")))

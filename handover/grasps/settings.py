"""What tunes the search for grasps beside `GraspSettings`, which a set keeps."""

from dataclasses import dataclass

from roadmap.ranges import CheckedSettings, setting


@dataclass(frozen=True)
class HoldSettings(CheckedSettings):
    """How closely a hand closes, and how hard it is looked whether it holds.

    Attributes:
        centred: Tries to put an object between the jaws of a gripper.
        each: Contacts kept of one link's patch: the nearest first, then the farthest
            off. Fewer withstand less, so what is told to hold, holds.
        directions: Pushes against which a grasp is tried before its hull is made.
        descent: Steps towards the weakest of them. More: fewer hulls are made in vain.
        drawn: Points of the surface drawn for each one that is kept. More: evener.
    """

    centred: int = setting(4, 1, 100_000)
    each: int = setting(2, 1, 100_000)
    directions: int = setting(512, 1, 100_000)
    descent: int = setting(40, 1, 100_000)
    drawn: int = setting(40, 1, 100_000)


HOLD = HoldSettings()

"""A person before the Kawasaki, a workspace and a small map of it: for many tests."""

import numpy as np

from handover import Human
from handover.meet.held_object import wrench
from handover.meet.settings import MeetSettings, QualitySettings
from handover.meet.workspace import InteractionWorkspace

FLOOR_M = -0.75  # of the person, in the frame of the robot's base
# a board between a person and what is held out, through which they cannot reach
BOARD = {"type": "box", "size": [0.02, 1.0, 0.3], "position": [0.55, 0.0, 0.45]}


def person(distance, aside=0.0):
    """Return a person who faces the base from so far away, right arm half bent."""
    body = Human().placed(distance, aside, np.pi)
    T = body.T_world_pelvis.copy()
    T[2, 3] += FLOOR_M
    joints = np.radians([20.0, 10.0, 0.0, 60.0, 0.0, 0.0, 0.0])
    return body.moved(T).with_arm("right", joints).looking_at(np.zeros(3))


def workspace(reach, human, **settings):
    """Return a coarse workspace of a robot and a person.

    The hand's way counts one half: the scenes of the tests were drawn so, and with more
    the best places are beside the hand, where the small robot has no configuration.
    """
    quality = QualitySettings(online_weight=0.5)
    grid = {"cell": 0.15, "rotations": 72, "marked_share": 0.3, "quality": quality}
    grid |= settings
    return InteractionWorkspace(reach, human, wrench(), 4, MeetSettings(**grid))

"""Where a person would rather not have the robot pass, and how new paths are told.

Two places are told to the planner as places where somebody is about to be
(`ReactivePlanner.expect`): new paths keep clear of them where they can. They are costs:
nothing is blocked or freed by them, and a person who stands badly is still served.
"""

import math

import numpy as np

from handover.human.body import Part
from sim.story.settings import ComfortSettings, ShunnedSettings


def shunned(
    capsules: np.ndarray,
    labels: np.ndarray,
    hand: np.ndarray,
    gaze: np.ndarray | None,
    settings: ComfortSettings,
    rods: ShunnedSettings = ShunnedSettings(),
) -> np.ndarray:
    """Return (k, 7) capsules that new paths had better keep clear of.

    Args:
        capsules: (n, 7) the person [m].
        labels: (n,) `handover.Part` of each.
        hand: Which of them are the hand that takes part.
        gaze: (3,) where they look, in the capsules' frame; None: not known there.
        settings: See ComfortSettings.
        rods: Where they are.
    """
    found = []
    head = capsules[labels == Part.HEAD, :6].reshape(-1, 3)
    if not len(head):
        return np.zeros((0, 7))
    face = _middle(head)
    if settings.face_to_hand and len(hand):
        away = _middle(capsules[hand, :6].reshape(-1, 3)) - face
        far = math.sqrt(away @ away)
        if far > rods.short:
            end = face + (1.0 - rods.short / far) * away
            found.append([*face, *end, settings.face_to_hand])
    if settings.unseen and gaze is not None:
        flat = np.array([gaze[0], gaze[1], 0.0])
        long = math.sqrt(flat @ flat)
        if long > 1e-6:
            behind = face - rods.behind / long * flat
            below = behind - [0.0, 0.0, rods.down]
            found.append([*behind, *below, settings.unseen])
    return np.array(found).reshape(-1, 7)


def _middle(points: np.ndarray) -> np.ndarray:
    """Return the mean (3,) of points (n, 3) [m]."""
    return np.add.reduce(points) / len(points)

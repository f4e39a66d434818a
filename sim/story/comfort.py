"""Where new paths had better not pass, and how the planner is told.

Two places are told to the planner as places where somebody is about to be
(`ReactivePlanner.expect`): new paths keep clear of them where they can. They are costs:
nothing is blocked or freed by them, and a person who stands badly is still served.

And a robot that takes long to stop passes a person with as much room as they may cover
in its shortest stop (`Berth`): nearer it would creep for as long as it is patient.
"""

import math

import numpy as np

from handover.human.body import Part
from odm.execution.executor import Executor
from odm.execution.slowest_stop import slowest_stop
from odm.execution.threat import ThreatSettings
from odm.obstacles.obstacles import Obstacles
from roadmap.geometry.gaps import ball_gaps
from sim.story.settings import ComfortSettings, ShunnedSettings

QUICK = 0.005  # [m] who comes no farther meanwhile makes nobody creep
_WIDEST = 0.10  # [m] of a berth: a sensor may be worse, but a person has to be passed
_BRINK = 0.002  # [m] nearer than a berth and this, the robot is in it
_NONE_FOR = 100  # frames without a berth where none leads on; then twice as many


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


class Berth:
    """Tells the planner of a person who is larger by what a slow robot had better keep.

    All that is free beside the larger person is free beside the person. Where that
    leads nowhere, or the robot is nearer already, the planner is told of the person as
    they are.

    Args:
        executor: Of the robot; it knows how the stops are.
        threat: What is assumed of the person.

    Attributes:
        room: What is kept besides the clearance [m]; 0 for a robot that is quick to
            stop.
        clearance: What is kept by all [m].
        told: How much larger the person was, as told last [m].
    """

    def __init__(self, executor: Executor, threat: ThreatSettings) -> None:
        """Look how long the robot takes to stop."""
        how = executor.settings, executor.period, threat
        comes = slowest_stop(executor.robot, *how)[1]
        self.room = min(comes, _WIDEST) if comes > QUICK else 0.0
        self.clearance = executor.planner.cell_map.safety.m
        self.told = 0.0
        self._waits, self._again = 0, _NONE_FOR

    def begin(self) -> None:
        """Try anew, with another goal."""
        self._waits, self._again = 0, _NONE_FOR

    def around(
        self, there: Obstacles, people: int, balls: np.ndarray, held: bool
    ) -> Obstacles:
        """Return all shapes, the person with the berth if that is of use.

        Args:
            there: All shapes, base frame.
            people: How many of its capsules are the person's: they come first.
            balls: (n, 4) the moving spheres of the robot's cover, and what it holds.
            held: Whether the planner had no path in the frame before.
        """
        if self.told and held:
            self._waits, self._again = self._again, 2 * self._again
        self.told, waits = 0.0, self._waits > 0
        self._waits -= waits
        if waits or not self.room or not people:
            return there
        rows = np.array(there.capsules)
        least = ball_gaps(balls, rows[:people]).min()
        if not least > self.clearance + self.room + _BRINK:
            return there
        rows[:people, 6] += self.room
        self.told = self.room
        return Obstacles(capsules=rows)


def _middle(points: np.ndarray) -> np.ndarray:
    """Return the mean (3,) of points (n, 3) [m]."""
    return np.add.reduce(points) / len(points)

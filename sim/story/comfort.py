"""Where new paths do not pass, if they can, and how the planner is told.

Two places are told to the planner as if somebody were about to be there
(`ReactivePlanner.expect`): new paths keep clear of them where they can. They are costs:
nothing is blocked or freed by them, and a person who stands badly is still served.

A robot that takes long to stop passes a person with as much room as they may cover in
its shortest stop (`Berth`): nearer it would creep.
"""

import math
from dataclasses import replace

import numpy as np

from handover.human.body import Part
from odm.execution.executor import Executor
from odm.execution.stop_test import slowest_stop
from odm.execution.threat import ThreatSettings
from odm.obstacles.obstacles import Obstacles
from roadmap.geometry.gaps import ball_gaps
from sim.story.settings import ComfortRodSettings, ComfortSettings

UP = np.array([0.0, 0.0, 1.0])
QUICK = 0.005  # [m] who comes no farther meanwhile makes nobody creep
_WIDEST = 0.10  # [m] of a berth: a sensor may be worse, but a person has to be passed
_BRINK = 0.002  # [m] nearer than a berth and this, the robot is in it
_SHARES = 1.0, 0.5, 0.25, 0.0  # of a berth: the next one where none leads on,
_PATIENT = 25  # ... for so many frames: the planner's search goes on over several,
_RATES = 15, 20, 25, 30, 50, 100  # [Hz] of frames, one of which may be enough
_LESS_FOR = 100  # ... until it was hindered in so many; then in twice as many


def comfort_rods(
    capsules: np.ndarray,
    labels: np.ndarray,
    hand: np.ndarray,
    gaze: np.ndarray | None,
    settings: ComfortSettings,
    rods: ComfortRodSettings = ComfortRodSettings(),
    up: np.ndarray = UP,
) -> np.ndarray:
    """Return (k, 7) capsules that new paths keep clear of, if they can.

    Args:
        capsules: (n, 7) the person [m].
        labels: (n,) `handover.Part` of each.
        hand: Which of them are the hand that takes part.
        gaze: (3,) where they look, in the capsules' frame; None: not known there.
        settings: See ComfortSettings.
        rods: Where they are.
        up: (3,) against gravity, a unit vector in the capsules' frame.
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
        flat = gaze - (gaze @ up) * up
        long = math.sqrt(flat @ flat)
        if long > 1e-6:
            behind = face - rods.behind / long * flat
            below = behind - rods.down * up
            found.append([*behind, *below, settings.unseen])
    return np.array(found).reshape(-1, 7)


class Berth:
    """Shows the planner a larger person, from whom a slow robot keeps more distance.

    What they hold out is shown larger, too, since it moves as they do. All that is free
    beside the larger person is free beside the person. A part that is nearer to the
    robot already grows only up to the robot: a path comes no nearer to it than now,
    where there is a way. If none is found, the growth is halved, then halved again,
    then nothing.

    Args:
        executor: Of the robot; it knows how long its stops take.
        threat: What is assumed of the person.
        seen_every: Time between what is seen of them, where more than the period [s].

    Attributes:
        room: Distance kept beyond the clearance [m]; 0 for a robot that stops quickly,
            until it stood braked on a way that was free.
        clearance: What every robot keeps [m].
        period: Time between two frames in which something new is seen [s].
        stop_s, comes: How long its shortest stop takes, a frame included [s], and how
            much nearer somebody may come meanwhile [m].
        told: The least growth of the person's parts, as told last [m].
    """

    def __init__(
        self, executor: Executor, threat: ThreatSettings, seen_every: float = 0.0
    ) -> None:
        self.period = max(executor.period, seen_every)
        how = executor.settings, self.period, threat
        self.stop_s, comes = slowest_stop(executor.robot, *how)
        self.comes = comes
        exact = replace(threat, noise=0.0)  # by rate of the frames [Hz]
        times = {round(1.0 / self.period): self.period} | {r: 1.0 / r for r in _RATES}
        self._come = {
            rate: slowest_stop(executor.robot, executor.settings, time, exact)[1]
            for rate, time in times.items()
        }
        self._usual = min(comes, _WIDEST) if comes > QUICK else 0.0
        self.clearance = executor.planner.cell_map.safety.m
        self.told = 0.0
        self._larger = False  # whether any part was larger, as told last
        self.begin()

    def begin(self) -> None:
        """Try anew, with another goal."""
        self.room = self._usual
        self._level, self._left, self._again = 0, 0, _LESS_FOR
        self._held = 0  # frames in a row

    def why_too_rare(self, most: float, vain: bool) -> str:
        """Return what to do about frames too rare to close on an object; or empty.

        `most` is how much nearer somebody may come before the robot stands [m]; `vain`:
        it was tried. Before that only what more frames would mend is told.
        """
        rare = self._come[round(1.0 / self.period)] > most
        enough = [rate for rate in _RATES if self._come[rate] <= most]
        if not (rare and enough or vain and self.comes > most):
            return ""
        often = f"at least {enough[0]} frames a second" if rare and enough else ""
        return (
            f"with a frame every {1e3 * self.period:.0f} ms it stands "
            f"{1e3 * self.stop_s:.0f} ms after what it saw, and by then what is held "
            f"out may have come {100 * self.comes:.1f} cm nearer (limit "
            f"{100 * most:.1f} cm): give {often or 'frames more often'}, the robot's "
            "own limits of acceleration and jerk, or, for people who hold still, "
            "StorySettings(threat=ThreatSettings(acceleration=...)); or hold it still "
            "between the fingers"
        )

    def widen(self, room: float) -> None:
        """Keep at least `room` [m] from now on, until `begin`."""
        self.room = max(self._usual, room)

    def around(
        self,
        there: Obstacles,
        people: int,
        balls: np.ndarray,
        held: bool,
        hindered: bool,
    ) -> Obstacles:
        """Return all shapes, the person with the berth if that is of use.

        Args:
            there: All shapes, base frame.
            people: How many of its capsules are the person's, and what they hold out:
                they come first.
            balls: (n, 4) the moving spheres of the robot's cover, and what it holds.
            held: Whether the planner had no path in the frame before.
            hindered: Whether the robot stands, or goes slowly for the person's sake:
                else a path that was found is good enough.
        """
        self._held = self._held + 1 if self._larger and held else 0
        if self._held >= _PATIENT:
            self._lower()
        elif self._left and hindered:
            self._left -= 1
            if not self._left:
                self._level = 0
        self.told, self._larger = 0.0, False
        share = _SHARES[self._level]
        if not share or not self.room or not people:
            return there
        rows = np.array(there.capsules)
        spare = ball_gaps(balls, rows[:people]).min(axis=0) - self.clearance - _BRINK
        larger = np.clip(spare, 0.0, share * self.room)
        self.told = float(larger.min())
        self._larger = bool(larger.any())
        if not self._larger:
            return there
        rows[:people, 6] += larger
        told, n = Obstacles(capsules=rows), len(rows)
        words = there.labels.get("capsules", [""] * n)
        rooms = [_room_text(wider) for wider in larger.tolist()] + [""] * (n - people)
        both = zip(words, rooms, strict=True)
        told.labels = {"capsules": [" ".join(filter(None, one)) for one in both]}
        return told

    def _lower(self) -> None:
        """Keep less for a while, and each time for longer."""
        self._held = 0
        if not self._level:
            self._left, self._again = self._again, 2 * self._again
        self._level = min(self._level + 1, len(_SHARES) - 1)


def _room_text(wider: float) -> str:
    """Return the name of what a part is told larger by [m]; reasons measure to it."""
    return f"with {100 * wider:.1f} cm of room around it" if wider > 0.0 else ""


def _middle(points: np.ndarray) -> np.ndarray:
    """Return the mean (3,) of points (n, 3) [m]."""
    return np.add.reduce(points) / len(points)

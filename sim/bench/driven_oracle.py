"""The trips of a robot with perfect eyes and a perfect planner, but its own dynamics.

The oracles of `sim.bench.trip_oracle` are at full speed at once, and in all corners.
Here our own executor drives: it gets up speed and stops within the joints' acceleration
and jerk, rounds corners within the map's blending share, chooses its speed and yields
as ever. What it asks is answered by exact distances; the ways are those of who sees the
person as they are and lately were, 3 cm clear of that where there is such a way. So
what this robot loses is lost to dynamics and braking test, and what ours loses besides
to cells, cover and planning. It is a policy, no strict bound.
"""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from odm.exact.distances import ExactObstacles, capsule_obstacles
from odm.obstacles.obstacles import Obstacles
from roadmap.kinematics.forward import difference
from roadmap.motion.blending import joint_motion_bounds
from roadmap.motion.motion import time_path
from sim.bench.trip_oracle import TripOracle
from sim.loop.loop import Loop, LoopSettings
from sim.people.human_motion import HumanMotion

_LOOK = 0.05  # [s] between two looks for a better way
_LATELY = (0.05, 0.1, 0.15, 0.2)  # [s] a new way is clear of where the person was then,
_CLEAR = 0.03  # [m] and keeps so much more than m, where there is such a way
_FINEST = 1e-3  # [m] a way is measured at places no nearer to each other than this
_ON = 1e-4  # [rad or m] beside its way it is on it
_NOBODY = np.zeros((0, 7))


class ExactPlanner:
    """Answers a loop and its executor by exact distances; see the module.

    Args:
        oracle: Whose robot, places and ways these are.
    """

    def __init__(self, oracle: TripOracle) -> None:
        """Stand at the first place, on the way to the second."""
        planner = oracle.planner
        self.cell_map, self.static = planner.cell_map, planner.static
        self.frame = planner.frame  # tells where the base stands
        self._oracle, self._m = oracle, oracle.m
        self._bounds = joint_motion_bounds(planner.robot)
        self._seen: dict[int, np.ndarray] = {}  # the person by time [ms]
        self._there = capsule_obstacles(_NOBODY)
        self.set_goals(oracle.places[1:2])

    def set_goals(self, goals: Sequence[np.ndarray]) -> None:
        """Go to one of the oracle's places from now on."""
        off = np.abs(self._oracle.places - goals[0]).max(axis=1)
        self._place, self._looked = int(off.argmin()), -_LOOK
        self._way: list[np.ndarray] = []

    def step(self, shapes: Obstacles, q: np.ndarray, now: float, **_: object) -> Any:  # noqa: ANN401 (what a loop needs of an answer)
        """Answer a frame: on along the way, by a better one, or not at all."""
        rows = np.array(shapes.capsules)
        self._seen[round(1e3 * now)] = rows
        self._there = capsule_obstacles(rows)
        rest = self._rest(q)
        way = rest if rest and self.blocked_leg(np.array(rest)) is None else []
        if now - self._looked > _LOOK - 1e-6 or (rest and not way):
            self._looked = now
            way = self._better(way, q, rows, now)
        self._way = way
        status = "following" if way is rest else "replanned"
        path = np.array(way).reshape(-1, len(q))
        given = {"reason": "", "retreat": None, "latency_s": {}}
        return SimpleNamespace(status=status if way else "holding", path=path, **given)

    def _better(
        self, way: list[np.ndarray], q: np.ndarray, rows: np.ndarray, now: float
    ) -> list[np.ndarray]:
        """Return a way that is sooner at the place than the present one, or that."""
        times = (round(1e3 * (now - t)) for t in _LATELY)
        lately = np.vstack([rows, *(self._seen.get(t, _NOBODY) for t in times)])
        for person, more in ((lately, _CLEAR), (rows, 0.0)):
            self._oracle.m = self._m + more
            given = way, q, self._place, person, self._takes
            found = self._oracle.way_by_sight(*given)
            self._oracle.m = self._m
            if found:
                return found
        return []

    def _takes(self, way: list[np.ndarray]) -> float:
        """Return how long a way takes from rest to rest, with its corners [s]."""
        how = {
            "blend": self.cell_map.safety.blending,
            "speed_scale": self._oracle.scale,
        }
        return time_path(self.static.robot, np.array(way), **how).duration

    def _rest(self, q: np.ndarray) -> list[np.ndarray]:
        """Return what is left of the way from q on, [] where q is beside it."""
        robot = self.static.robot
        for k, (a, b) in enumerate(zip(self._way[:-1], self._way[1:], strict=True)):
            leg, at = difference(robot, a, b), difference(robot, a, q)
            share = np.clip(leg @ at / max(leg @ leg, 1e-18), 0.0, 1.0)
            if np.abs(at - share * leg).max() < _ON:
                return [q, *self._way[k + 1 :]]
        return []

    def blocked_leg(
        self, path: np.ndarray, extra: float = 0.0, points: Obstacles | None = None
    ) -> int | None:
        """Return the first leg of a path that comes within m + `extra` of capsules.

        None where there is none. Without `points` they are those of the frame.
        """
        there = self._there if points is None else capsule_obstacles(points.capsules)
        legs = [difference(self.static.robot, *pair) for pair in zip(path, path[1:])]
        for k, leg in enumerate(legs or [np.zeros_like(path[0])]):
            if not self._keeps(path[k], leg, self._m + extra, there):
                return k
        return None

    def _keeps(
        self, q: np.ndarray, leg: np.ndarray, keeps: float, there: ExactObstacles
    ) -> bool:
        """Whether a straight motion keeps a distance [m], by conservative steps."""
        far, done = max(float(self._bounds @ np.abs(leg)), 1e-12), 0.0
        while True:
            cap = keeps + max((1.0 - done) * far, _FINEST)
            gap = self._oracle.exact.distance(q + done * leg, there, cap).distance
            if not gap > keeps:
                return False
            if done >= 1.0:
                return True
            done = min(1.0, done + max(gap - keeps, _FINEST) / far)

    def separation(self, q: np.ndarray) -> float:
        """Return the exact distance of the robot at q (dof,) from the person [m]."""
        return self._oracle.exact.distance(q, self._there).distance

    def evasion(
        self,
        q: np.ndarray,
        coming: Sequence[tuple[float, Obstacles]],
        speed_scale: float,
    ) -> np.ndarray | None:
        """Return (2, dof) a motion from q out of the way of who comes, or None."""
        way = self._oracle.way_out(q, self._place, coming)
        return np.array(way) if way else None


def trips_driven(
    oracle: TripOracle, human: HumanMotion | None, seconds: float
) -> float:
    """Return the trips in a time [s], the last one by how much of it was done."""
    settings = LoopSettings(
        duration_s=seconds, speed_scale=oracle.scale, execution="timed", improve=0
    )
    given = ExactPlanner(oracle), oracle.planner.robot, oracle.places, human, settings
    loop = Loop(*given)
    for _ in range(round(seconds * settings.rate_hz)):
        frame = loop.frame()
    return loop.trips + oracle.done(frame.q, loop.place)

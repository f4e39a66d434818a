"""Two robots in one space, each the moving obstacle of the other.

World is the base frame of the first robot. In every frame each robot sees the other's
links where they are, plans round them and brakes for what the other may still sweep
(`sim.robot_threat`). They decide one after the other, so that the second one knows
what the first one holds tested; both move on afterwards.

A robot whose work place is taken waits at a place of its own, out of the other's way.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from odm.answer import HOLDING
from odm.cell_map import CellMap
from odm.planner import ReactivePlanner
from odm.robot_surface import RobotSurface, standing_shapes
from roadmap.errors import BadInput
from roadmap.kinematics import difference
from roadmap.motion import Motion, time_path
from sim.execution import ExecutionSettings, Executor
from sim.robot_pair import ExactPair
from sim.robot_threat import intent_of, intent_threat, limits_threat
from sim.run_result import STATUS, kind_of
from sim.two_places import places_beside, waiting_place
from sim.two_result import TwoResult

ARRIVED = 1e-6  # largest joint difference at which a place is reached
ASK_AGAIN = (0.1, 0.5)  # [s] between two looks whether a work place is free again
WATCHED = 24  # places on the way of a script that are kept free
LEAVE = 0.3  # [s] without a way before it goes and waits
PATIENCE, TURN = 1.0, 6.0  # [s] waited before the other gives way, and for how long
PLANNED, SCRIPTED = "planned", "scripted"


@dataclass(frozen=True)
class TwoSettings:
    """How long and how fast two robots run.

    Attributes:
        rate_hz: Frames per second.
        duration_s: Simulated time [s].
        other: "planned": the second robot plans, too, and tells what it will do.
            "scripted": it goes to and fro and heeds nothing; only its joints are known.
        speed_scale: Share of the joints' speed limits that they use.
        script_scale: The same for a scripted robot.
        script_rest_s: Time it rests at each of its places [s].
        polish: Motions a planner may test between two frames to shorten its path.
        heed: False takes the braking away: for the test that it is needed.
    """

    rate_hz: float = 100.0
    duration_s: float = 120.0
    other: str = PLANNED
    speed_scale: float = 0.5
    script_scale: float = 0.1
    script_rest_s: float = 5.0
    polish: int = 4
    heed: bool = True

    def __post_init__(self) -> None:
        """Refuse values that make no run."""
        for name in ("rate_hz", "duration_s"):
            value = getattr(self, name)
            if not 0 < value < np.inf:
                raise BadInput(f"{name} is {value}; give a number above 0")
        for name in ("speed_scale", "script_scale"):
            value = getattr(self, name)
            if not 0 < value <= 1:
                raise BadInput(f"{name} is {value}; give a share in (0, 1]")
        if self.other not in (PLANNED, SCRIPTED):
            raise BadInput(
                f"other is {self.other!r}; choose {PLANNED} or {SCRIPTED}"
            )


class Planned:
    """One robot that plans: what it heeds, where it goes, how often it got there.

    It works at its places in turn. Where no way leads to the next one for a while it
    goes and waits, and asks now and then whether there is a way again.

    Args:
        planners: One that leads it, one that is asked; the other robot's standing
            links are their scenery.
        places: (n, dof) work places.
        wait: (dof,) where it begins, and waits.
        settings: Rate and speeds.
        ask_again: Time between two questions [s]: not the same for two robots, which
            could wait for each other otherwise.

    Attributes:
        q: (dof,) where it is.
        trips: Times it arrived at a work place.
        arrived: Whether it arrived in this frame.
        waited_s: How long it has had no way to work [s].
        gives_way: Whether it waits although it has a way.
    """

    def __init__(
        self,
        planners: tuple[ReactivePlanner, ReactivePlanner],
        places: np.ndarray,
        wait: np.ndarray,
        settings: TwoSettings,
        ask_again: float,
    ) -> None:
        """Stand at the waiting place."""
        self.planner, self._asker = planners
        self.robot, self.settings = self.planner.robot, settings
        self.places, self.wait, self.place, self.trips = places, wait, 0, 0
        self.gives_way, self.waited_s, self.arrived = False, 0.0, False
        self._period = 1.0 / settings.rate_hz
        self._ask_again = ask_again
        self._held_s = self._since_s = 0.0
        shares = ExecutionSettings(settings.speed_scale)
        if settings.other == PLANNED:  # the other one leaves; no need to back off
            shares = ExecutionSettings(settings.speed_scale, stand_below=np.inf)
        self.executor = Executor(
            self.robot, self.planner, wait.copy(), self._period, shares
        )
        self.q = self.executor.set_point.q
        self.status, self.wall_s, self.reason = 0, 0.0, ""
        self.planner.reset()
        self._aim(True)

    def intent(self) -> tuple:
        """Return all that it may still do without another test."""
        return intent_of(self.executor)

    def decide(self, points: np.ndarray, threat: object, now: float) -> None:
        """Answer a frame: the other's points, and what it may still sweep."""
        commit = self.executor.commit()
        self._since_s += self._period
        asks = not (self.works or self.gives_way) and self._since_s >= self._ask_again
        if asks:
            self._since_s = 0.0
            self._asker.set_goals([self.places[self.place]])
            if len(self._asker.step(points, q=commit.q).path):
                self._aim(True)
        begun = time.perf_counter()
        dq = self.executor.set_point.dq
        answer = self.planner.step(points, q=commit.q, dq=dq, stamp=now, now=now)
        self.wall_s = time.perf_counter() - begun
        self.executor.heed(answer, commit, threat)
        self.status = STATUS.index(answer.status)
        held = answer.status == HOLDING
        self.reason = (answer.reason or "") if held else ""
        self._held_s = self._held_s + self._period if held else 0.0
        lost = not self.gives_way and (held or not self.works)
        self.waited_s = self.waited_s + self._period if lost else 0.0
        if self.works and self._held_s > LEAVE:
            self._aim(False)

    def give_way(self, yes: bool) -> None:
        """Leave the work place to the other robot, or go on working."""
        self.gives_way = yes
        self._aim(not yes)

    def _aim(self, works: bool) -> None:
        """Go to the next work place, or to where it waits."""
        self.works = works
        self.planner.set_goals([self.places[self.place] if works else self.wait])
        self.executor.new_goal()

    def advance(self) -> None:
        """Move on by one period; at a work place, take the next one as the goal."""
        if self.settings.polish:
            self.planner.polish(self.settings.polish)
        self.executor.advance()
        self.q = self.executor.set_point.q
        off = difference(self.robot, self.q, self.places[self.place])
        self.arrived = self.works and self.executor.at_rest
        self.arrived = self.arrived and bool(np.abs(off).max() <= ARRIVED)
        if self.arrived:
            self.trips += 1
            self.place = (self.place + 1) % len(self.places)
            self._aim(True)


class Scripted:
    """A robot that goes to and fro between its places, whatever stands there."""

    status, wall_s, reason = 0, 0.0, ""

    def __init__(self, cell_map: CellMap, ways: list, settings: TwoSettings) -> None:
        """Begin at the first place; `ways` (n,) of corners lead round all of them."""
        self.robot, self.settings = cell_map.robot, settings
        scale = settings.script_scale
        self.motions: list[Motion] = [
            time_path(self.robot, way, speed_scale=scale) for way in ways
        ]
        self.place, self.trips, self.t = 1, 0, 0.0
        self.q = self.motions[0].at(0.0).q

    @property
    def motion(self) -> Motion:
        """The motion it is on."""
        return self.motions[(self.place - 1) % len(self.motions)]

    @property
    def dq(self) -> np.ndarray:
        """(dof,) its joint velocities [rad/s or m/s]."""
        return self.motion.at(self.t).dq

    def advance(self) -> None:
        """Move on by one period."""
        self.t += 1.0 / self.settings.rate_hz
        if self.t >= self.motion.duration + self.settings.script_rest_s:
            self.t = 0.0
            self.place = (self.place + 1) % len(self.motions)
            self.trips += 1
        self.q = self.motion.at(self.t).q


class TwoRobots:
    """The state of both between frames.

    Args:
        maps: The maps of the two robots; the same one twice is fine.
        T_world_base: (4, 4) base of the second one in the base frame of the first.
        settings: Rate, time and who plans.

    Raises:
        BadInput: The bases meet, or leave a robot no place to work or to wait.
    """

    def __init__(
        self,
        maps: tuple[CellMap, CellMap],
        T_world_base: np.ndarray,
        settings: TwoSettings | None = None,
    ) -> None:
        """Put both at the places where they wait."""
        self.settings = settings or TwoSettings()
        T = np.asarray(T_world_base, float)
        self.T = (np.eye(4), T)
        # base of the other one in the base frame of robot 0 and 1
        self.T_other = (T, np.linalg.inv(T))
        robots = [m.robot for m in maps]
        self.exact = ExactPair(*robots, T)
        self.exact.require_apart(max(m.safety.m for m in maps))
        self.surfaces = [
            RobotSurface(robot, maps[1 - k].safety.rho, "moving")
            for k, robot in enumerate(robots)
        ]
        planners = [(ReactivePlanner(m), ReactivePlanner(m, True)) for m in maps]
        for k, pair in enumerate(planners):
            self.surfaces[1 - k].require(maps[k].safety.rho)
            shapes = standing_shapes(robots[1 - k], self.T_other[k])
            for planner in pair:
                planner.set_static(shapes)
        places = [places_beside(planner) for planner, _ in planners]
        self.index = 0
        self._turn = 0, 0.0  # trips of the one that is given way, and until when
        if self.settings.other == SCRIPTED:
            ways = _ways_round(planners[1][0], places[1])
            script = Scripted(maps[1], ways, self.settings)
            busy = np.vstack([_places_on(m) for m in script.motions])
            self.robots = [self._planned(0, planners, places[0], busy), script]
            return
        first = self._planned(0, planners, places[0], places[1])
        beside = np.vstack([places[0], first.wait])
        self.robots = [first, self._planned(1, planners, places[1], beside)]

    def _planned(
        self, k: int, planners: list, places: np.ndarray, busy: np.ndarray
    ) -> Planned:
        """Return robot k, waiting beside the other one at all of `busy` (n, dof)."""
        surface, T = self.surfaces[1 - k], self.T_other[k]
        points = np.concatenate([surface.at(q, T).copy() for q in busy])
        wait = waiting_place(planners[k][0], places, points)
        return Planned(planners[k], places, wait, self.settings, ASK_AGAIN[k])

    def frame(self) -> None:
        """Let the robots decide one after the other, then move both."""
        now = self.index / self.settings.rate_hz
        for k, robot in enumerate(self.robots):
            if isinstance(robot, Scripted):
                continue
            other, surface = self.robots[1 - k], self.surfaces[1 - k]
            points = surface.at(other.q, self.T_other[k]).copy()
            robot.decide(points, self._threat(k, other), now)
        for robot in self.robots:
            robot.advance()
        if self.settings.other == PLANNED:
            self._take_turns(now)
        self.index += 1

    def _take_turns(self, now: float) -> None:
        """Let one that arrived give way to one that waits, for one trip of it."""
        for one, other in (self.robots, self.robots[::-1]):
            if one.gives_way and (other.trips > self._turn[0] or now > self._turn[1]):
                one.give_way(False)
            elif one.arrived and other.waited_s > PATIENCE:
                self._turn = other.trips, now + TURN
                one.give_way(True)

    def _threat(self, k: int, other: object) -> object:
        surface, T = self.surfaces[1 - k], self.T_other[k]
        if not self.settings.heed:
            return None
        if isinstance(other, Scripted):
            scale = self.settings.script_scale
            return limits_threat(surface, T, other.q, other.dq, speed_scale=scale)
        return intent_threat(surface, other.intent(), T)

    def separation(self) -> float:
        """Return the exact distance of the two robots, bases included [m]."""
        return self.exact.distance(self.robots[0].q, self.robots[1].q)


def run_two(
    maps: tuple[CellMap, CellMap],
    T_world_base: np.ndarray,
    settings: TwoSettings | None = None,
    on_frame: Callable[[int, int], None] | None = None,
) -> TwoResult:
    """Run two robots for their whole time; the arguments are those of `TwoRobots`.

    `on_frame(done, total)` is called after every frame.

    Returns:
        Every frame and the figures; the same input gives the same result but for the
        clock's figures.
    """
    settings = settings or TwoSettings()
    two = TwoRobots(maps, T_world_base, settings)
    total = max(1, round(settings.duration_s * settings.rate_hz))
    rows: dict[str, list] = {n: [] for n in ("q", "status", "wall_s", "place")}
    separation, held = [], ({}, {})
    for index in range(total):
        separation.append(two.separation())
        rows["q"].append([r.q.copy() for r in two.robots])
        rows["place"].append([r.place for r in two.robots])
        two.frame()
        rows["status"].append([r.status for r in two.robots])
        rows["wall_s"].append([r.wall_s for r in two.robots])
        for k, robot in enumerate(two.robots):
            if robot.reason:
                first, n = held[k].get(kind_of(robot.reason), (robot.reason, 0))
                held[k][kind_of(robot.reason)] = first, n + 1
        if on_frame is not None:
            on_frame(index + 1, total)
    return TwoResult(
        other=settings.other,
        rate_hz=settings.rate_hz,
        trips=tuple(r.trips for r in two.robots),
        T_world_base=two.T[1],
        separation=separation,
        q=tuple(np.array([row[k] for row in rows["q"]]) for k in range(2)),
        place=np.array(rows["place"]),
        status=np.array(rows["status"]),
        wall_s=np.array(rows["wall_s"]),
        places=tuple(_places_of(r) for r in two.robots),
        reasons=tuple(dict(kinds.values()) for kinds in held),
    )


def _places_of(robot: object) -> np.ndarray:
    if isinstance(robot, Scripted):
        return np.array([motion.at(0.0).q for motion in robot.motions])
    return robot.places


def _places_on(motion: Motion) -> np.ndarray:
    """Return (n, dof) configurations spread over a motion."""
    return motion.sample(np.linspace(0.0, motion.duration, WATCHED)).q


def _ways_round(planner: ReactivePlanner, places: np.ndarray) -> list[np.ndarray]:
    """Return paths from each place to the next, past all that stands."""
    planner.reset()
    ways = []
    for k, q in enumerate(places):
        planner.set_goals([places[(k + 1) % len(places)]])
        answer = planner.step(np.zeros((0, 3)), q=q)
        if not len(answer.path):
            raise BadInput(f"the script has no way: {answer.reason}")
        ways.append(answer.path)
        planner.reset()
    return ways



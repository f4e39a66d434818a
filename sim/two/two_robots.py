"""Two robots in one space, each the moving obstacle of the other.

World is the base frame of the first robot. In every frame each robot sees the other's
links where they are, plans round them and brakes for what the other may still sweep
(`odm.execution.robot_threat`). They decide one after the other, so that the second one
knows what the first one holds tested; both move on afterwards.

A robot whose work place is taken waits at a place of its own, out of the other's way.
"""

from collections.abc import Callable

import numpy as np

from odm.cell_map.cell_map import CellMap
from odm.execution.robot_spheres import RobotSpheres
from odm.execution.robot_threat import intent_threat, limits_threat
from odm.obstacles.obstacles import Obstacles
from odm.obstacles.robot_surface import standing_shapes
from odm.planner.planner import ReactivePlanner
from roadmap.errors import BadInput, PlanningError
from roadmap.kinematics.forward import difference
from roadmap.motion.motion import Motion
from roadmap.ranges import check_kind, settings_of
from roadmap.transforms import check_pose
from sim.loop.run_result import kind_of
from sim.loop.work_places import work_places
from sim.two.robot_pair import ExactPair
from sim.two.two_members import PLANNED, SCRIPTED, Planned, Scripted, TwoSettings
from sim.two.two_result import TwoResult

ASK_AGAIN = (0.1, 0.5)  # [s] between two looks whether a work place is free again
WATCHED = 24  # places on the way of a script that are kept free
SPARE = 0.05  # kept beyond what the planner calls free, while waiting [m]
PATIENCE, TURN = 1.0, 6.0  # [s] waited before the other gives way, and for how long


class TwoRobots:
    """The state of both between frames.

    Args:
        maps: The maps of the two robots; the same one twice is fine.
        T_world_base: (4, 4) base of the second one in the base frame of the first.
        settings: Rate, time and who plans.

    Raises:
        BadInput: The bases meet, or leave a robot no place to work or to wait; other
            than two maps, or a base that is no pose.
    """

    def __init__(
        self,
        maps: tuple[CellMap, CellMap],
        T_world_base: np.ndarray,
        settings: TwoSettings | None = None,
    ) -> None:
        self.settings = settings_of(settings, TwoSettings)
        if len(maps) != 2:
            raise BadInput(f"there are {len(maps)} maps; give two, one of each robot")
        for one in maps:
            check_kind("a map", one, CellMap, "give what odm.load_map returns")
        T = check_pose(T_world_base, "T_world_base")
        self.T = (np.eye(4), T)
        # base of the other one in the base frame of robot 0 and 1
        self.T_other = (T, np.linalg.inv(T))
        robots = [m.robot for m in maps]
        self.exact = ExactPair(*robots, T)
        self.exact.require_apart(max(m.safety.m for m in maps))
        self.spheres = [RobotSpheres(robot) for robot in robots]
        planners = [(ReactivePlanner(m), ReactivePlanner(m, True)) for m in maps]
        for k, pair in enumerate(planners):
            shapes = standing_shapes(robots[1 - k], self.T_other[k])
            for planner in pair:
                planner.set_static(shapes)
        places = [places_beside(planner) for planner, _ in planners]
        self.index = 0
        self._turn = 0, 0.0  # trips of the one that is given way, and until when
        if self.settings.other == SCRIPTED:
            paths = _paths_round(planners[1][0], places[1])
            script = Scripted(maps[1], paths, self.settings)
            busy = np.vstack([_places_on(m) for m in script.motions])
            self.robots = [self._planned(0, planners, places[0], busy), script]
            return
        first = self._planned(0, planners, places[0], places[1])
        beside = np.vstack([places[0], first.wait])
        self.robots = [first, self._planned(1, planners, places[1], beside)]

    def _planned(
        self, k: int, planners: list, places: np.ndarray, busy: np.ndarray
    ) -> Planned:
        """Return robot k; it waits clear of the other one at all of `busy` (n, dof)."""
        spheres, T = self.spheres[1 - k], self.T_other[k]
        taken = Obstacles(spheres=np.concatenate([spheres.at(q, T) for q in busy]))
        wait = waiting_place(planners[k][0], places, taken)
        return Planned(planners[k], places, wait, self.settings, ASK_AGAIN[k])

    def frame(self) -> None:
        """Let the robots decide one after the other, then move both."""
        now = self.index / self.settings.rate_hz
        for k, robot in enumerate(self.robots):
            if isinstance(robot, Scripted):
                continue
            other = self.robots[1 - k]
            there = self.spheres[1 - k].obstacles(other.q, self.T_other[k])
            robot.decide(there, self._threat(k, other), now)
        for robot in self.robots:
            robot.advance()
        if self.settings.other == PLANNED:
            self._take_turns(now)
        self.index += 1

    def _take_turns(self, now: float) -> None:
        """Let a robot that has arrived yield to one that waits, for one trip."""
        for one, other in (self.robots, self.robots[::-1]):
            if one.yields and (other.trips > self._turn[0] or now > self._turn[1]):
                one.set_yields(False)
            elif one.arrived and other.waited_s > PATIENCE:
                self._turn = other.trips, now + TURN
                one.set_yields(True)

    def _threat(self, k: int, other: object) -> object:
        spheres, T = self.spheres[1 - k], self.T_other[k]
        if not self.settings.braking:
            return None
        if isinstance(other, Scripted):
            scale = self.settings.script_scale
            return limits_threat(spheres, T, other.q, other.dq, speed_scale=scale)
        return intent_threat(spheres, other.intent(), T)

    def separation(self) -> float:
        """Return the exact distance of the two robots, bases included [m]."""
        return self.exact.distance(self.robots[0].q, self.robots[1].q)


def run_two(
    maps: tuple[CellMap, CellMap],
    T_world_base: np.ndarray,
    settings: TwoSettings | None = None,
    on_frame: Callable[[int, int], None] | None = None,
) -> TwoResult:
    """Run two robots for their whole time, with the arguments of `TwoRobots`.

    `on_frame(done, total)` is called after every frame. The same input gives the same
    result but for the clock's figures.
    """
    settings = settings_of(settings, TwoSettings)
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


def _paths_round(planner: ReactivePlanner, places: np.ndarray) -> list[np.ndarray]:
    """Return paths from each place to the next, around all that stands still."""
    planner.reset()
    paths = []
    for k, q in enumerate(places):
        planner.set_goals([places[(k + 1) % len(places)]])
        answer = planner.step(np.zeros((0, 3)), q=q)
        if not len(answer.path):
            raise BadInput(f"the script has no path: {answer.reason}")
        paths.append(answer.path)
        planner.reset()
    return paths


def places_beside(planner: ReactivePlanner) -> np.ndarray:
    """Return two free work places (2, dof) of a planner whose scenery is set."""
    roadmap = planner.cell_map.roadmap
    try:
        return work_places(planner.robot, roadmap, planner.is_free)
    except PlanningError as error:
        raise BadInput(
            f"beside the other robot's base {planner.robot.name} has no two places to "
            f"work at ({error}); move the second base away"
        ) from error


def waiting_place(
    planner: ReactivePlanner, places: np.ndarray, busy: Obstacles
) -> np.ndarray:
    """Return the roadmap node nearest to the places that is out of the other's way.

    `places` (n, dof) are the robot's, `busy` is the other robot at all of its own.
    BadInput where it is in the way everywhere.
    """
    nodes = planner.cell_map.roadmap.nodes
    planner.step(busy, q=nodes[0].copy())
    far = np.abs(difference(planner.robot, nodes[:, None], places[None])).max(axis=2)
    order = np.argsort(far.max(axis=1), kind="stable")
    keep = planner.keep + SPARE
    for node in order:
        q = nodes[node].copy()
        if planner.separation(q) > keep and planner.is_free(q, q):
            planner.reset()
            return q
    raise BadInput(
        f"{planner.robot.name} has no place to wait that is out of the other robot's "
        "way; move the second base away"
    )

"""Two oracles for the legs of an answer; neither has a memory of earlier frames.

The first is another planner that has seen this frame alone: its static test and its
close test of each leg. The second is geometry: the robot's own solids, never spheres or
cells, against the obstacles as solids, along the whole leg. Their distances come from
`odm.exact.distances`, contacts from python-fcl too.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from odm.answer import Freedom
from odm.cell_map.cell_map import CellMap
from odm.exact.distances import ExactRobot, obstacles_of
from odm.exact.fcl_robot import FclRobot
from odm.obstacles.obstacles import Obstacles
from odm.obstacles.scenery import shape_of_row
from odm.obstacles.shapes import Box, Capsule, Shape
from odm.obstacles.surfaces import sample_capsules
from odm.planner.planner import ReactivePlanner
from odm.search.state import center_motion_bounds
from roadmap.kinematics._limits import LIMIT_TOLERANCE
from roadmap.kinematics.forward import difference
from roadmap.loading.held_link import with_payload
from roadmap.robot.robot import Robot
from roadmap.transforms import moved_points, pose_with, rotation_to_z

# [m] of samples, where the map's rho allows it; where the covering radius is declared
SPACING, DENSE = 0.03, 0.01
TOLERANCE = 1e-6  # [m] of exact distances
NEAR = 0.005  # [m] a leg that could not keep so much more is a near miss
STEP = 0.006  # [m] least advance along a leg between two exact distances
FAR = 0.3  # [m] distances beyond are not resolved, nor beyond twice what is kept
EVERY = 4  # of the places that are looked at, python-fcl and self-distance take one
PLACES = 513  # of a leg that are looked at where the whole is refused
SHAPES = ("shapes", "both")  # modes of `World` with shapes
# [m] a way out may lose what "no nearer than now" allows, and what shells stick out by
YIELDS = 0.003
GROUND = 20.0  # [m] side of the box that stands for a half-space


@dataclass
class World:
    """What stands around the robot, and how it is told.

    Attributes:
        capsules: (k, 7) obstacles of the frame, base frame [m].
        things: Scenery of the place, world frame.
        named: Whether they are objects of the planner's scene, exact; else they are
            set by `set_static`, as samples.
        T_world_base: (4, 4) pose of the base [m].
        extra: Extra clearance [m].
        held: (n, 4) spheres in the hand, tool frame [m]; None for nothing.
        others: Further obstacles of the frame, shapes of all kinds, base frame; they
            are told in the modes of shapes alone.
        mode: "rho": samples within the map's rho; "round": the same, and told that all
            is round; "dense": a smaller covering radius is declared; "shapes": shapes
            without samples; "both": the capsules as samples, the others as shapes.
        repeat: Samples are repeated until they are so many, once.
        rho: The map's covering radius [m].
    """

    capsules: np.ndarray = field(default_factory=lambda: np.zeros((0, 7)))
    things: list[Shape] = field(default_factory=list)
    named: bool = False
    others: list[Shape] = field(default_factory=list)
    T_world_base: np.ndarray = field(default_factory=lambda: np.eye(4))
    extra: float = 0.0
    held: np.ndarray | None = None
    mode: str = "rho"
    repeat: int = 0
    rho: float = SPACING

    def furnish(self, planner: ReactivePlanner) -> None:
        """Let the things stand around a planner's robot, and nothing else."""
        planner.scene.clear()
        loose = [] if self.named else self.things
        planner.set_static(loose or np.zeros((0, 3)))
        for k, thing in enumerate(self.things if self.named else []):
            planner.scene.add(f"thing {k}", thing)

    def shapes(self) -> list[Shape]:
        """Return those obstacles that the planner is given as shapes, base frame."""
        if self.mode not in SHAPES:
            return []
        rods = self.capsules if self.mode == "shapes" else self.capsules[:0]
        return [*_capsules(rods), *self.others]

    def solids(self) -> list[Shape]:
        """Return all obstacles of the frame as solids, base frame."""
        others = self.others if self.mode in SHAPES else []
        return [*_capsules(self.capsules), *others]

    def given(self) -> np.ndarray | Obstacles:
        """Return what `step` is given: samples, shapes, or both, world frame."""
        points = self.points()
        if self.mode not in SHAPES:
            return points
        if self.mode == "shapes":
            points = points[:0]
        T = self.T_world_base
        return Obstacles.of([shape.moved(T) for shape in self.shapes()], points)

    def points(self) -> np.ndarray:
        """Return samples (n, 3) of the frame's capsules, world frame [m]."""
        points = sample_capsules(self.capsules, self.spacing)
        if self.repeat and len(points):
            points = np.tile(points, (-(-self.repeat // len(points)), 1))
        self.repeat = 0
        return moved_points(points, self.T_world_base)

    @property
    def spacing(self) -> float:
        """Covering radius of the samples of the frame's capsules [m]."""
        return min(DENSE if self.mode == "dense" else SPACING, self.rho)

    def step_arguments(self) -> dict[str, float]:
        """Return the arguments of `step` that say how the points were sampled."""
        if self.mode == "dense":
            return {"covering_radius": self.spacing}
        if self.mode == "round" and len(self.capsules):
            return {"rounding": float(self.capsules[:, 6].min())}
        return {}


@dataclass
class Verdict:
    """What was found about the legs of one answer.

    Attributes:
        wrong: One sentence for each fault; empty where all legs are free.
        unproved: Legs of which the oracle refuses the whole, but no place: its
            tests give up at a resolution, and of a part of a motion at another place.
        near: Whether a leg comes near to what it must keep.
        exact: Whether exact geometry was asked.
        gap: Smallest exact distance less what must be kept [m]; inf where not asked.
        distance: Smallest exact distance itself [m].
    """

    wrong: list[str] = field(default_factory=list)
    unproved: int = 0
    near: bool = False
    exact: bool = False
    gap: float = np.inf
    distance: float = np.inf


class Judge:
    """Judges answers of planners on one map."""

    def __init__(self, cell_map: CellMap) -> None:
        """Make the planner that only ever sees one frame."""
        self.cell_map = cell_map
        self.oracle = ReactivePlanner(cell_map, always_replan=True)
        self._q = cell_map.roadmap.nodes[0].copy()
        self._plain = _ExactSide(cell_map, cell_map.robot)
        self._things: list[Shape] = []  # the scenery that the oracle knows
        self.begin()

    def begin(self) -> None:
        """Begin with another planner, around which nothing stands."""
        self._side, self._dirty = self._plain, True
        self._stand_free: set[bytes] = set()  # legs free of all that stands still

    def changed(self) -> None:
        """Take up the world anew: its base, scenery, clearance or hand has changed."""
        self._dirty = True

    def judge(
        self,
        world: World,
        given: np.ndarray | Obstacles,
        q: np.ndarray,
        path: np.ndarray,
        exact: bool,
        by_links: tuple[int, ...] = (),
        beside: bool = False,
    ) -> Verdict:
        """Judge a path (k, dof) that was answered from q, where it must begin.

        `given` is what the planner was given; `exact` asks exact geometry in any case,
        not only where it is near. Of the legs `by_links` the hulls of the links judge.
        `beside`: the robot is off its segment, so that the first leg is a new motion.
        """
        if self._dirty:
            self._take_up(world)
        verdict, robot, spent = Verdict(), self.cell_map.robot, 0.0
        if not np.array_equal(path[0], q):
            verdict.wrong.append(f"the path begins at {path[0]}, not at {q}")
        # its answers do not depend on q: it stays, and nothing is attached anew
        self.oracle.step(given, q=self._q, **world.step_arguments())
        path = path.copy()
        over = np.clip(path[0], robot.lower, robot.upper) - path[0]
        tolerated = ~robot.continuous & (np.abs(over) <= LIMIT_TOLERANCE)
        path[0] += np.where(tolerated, over, 0.0)
        # what keeps NEAR more from the frame's points keeps enough
        verdict.near = self.oracle.blocked_leg(path, NEAR) is not None
        for k, (a, b) in enumerate(zip(path, path[1:], strict=False)):
            key = a.tobytes() + b.tobytes()
            if key in self._stand_free and not verdict.near:
                continue
            ask = partial(self.oracle.is_free, by_links=k in by_links)
            freedom = ask(a, b)
            if freedom:
                self._stand_free.add(key)
                continue
            new = beside and k == 0 and freedom.failed == "scenery"
            if new and self._is_rounded(a, b):
                exact, spent = True, self.cell_map.safety.rounding
                continue
            if self._refuses_a_place(ask, a, b):
                verdict.wrong.append(f"leg {k}: {freedom.failed}: {freedom.reason}")
            else:
                verdict.unproved += 1
        if exact or verdict.near or verdict.wrong or verdict.unproved:
            self._measure(world, path, verdict, spent)
        return verdict

    def judge_way_out(
        self,
        world: World,
        given: np.ndarray | Obstacles,
        q: np.ndarray,
        path: np.ndarray,
    ) -> Verdict:
        """Judge a motion (2, dof) that is offered as a way out of a frame that holds.

        It is free of what stands still as any other. Of what is given in the frame no
        link comes nearer than it must be, or than it is now, up to `YIELDS`; of points
        nothing tells what is between them, which may come nearer by their spacing.
        """
        if self._dirty:
            self._take_up(world)
        verdict, oracle = Verdict(exact=True), self.oracle
        if not np.array_equal(path[0], q):
            verdict.wrong.append(f"the way out begins at {path[0]}, not at {q}")
        oracle.step(given, q=self._q, **world.step_arguments())
        dq = difference(self.cell_map.robot, path[0], path[1])
        if not oracle.static.motion_free(path[0], dq):
            verdict.wrong.append(f"way out: {oracle.static.why(path[0], dq)}")
        if not oracle.clear_of_others(path, 0.0, np.zeros((0, 7))):
            verdict.wrong.append("way out: a sphere comes nearer to the frame")
        T, m = np.linalg.inv(world.T_world_base), self.cell_map.safety.m
        kept, moving = m + world.extra, world.solids()
        things = [thing.moved(T) for thing in world.things]
        self._side.stand_around(things)
        self._tell(verdict, 0, self._side.leg(path[0], dq, kept, m))
        if moving:
            slack = YIELDS + (world.spacing if world.mode != "shapes" else 0.0)
            self._side.stand_around(moving)
            least = min(kept, self._side.distance(path[0])) - slack
            found = self._side.leg(path[0], dq, least, m)
            found.touches &= least > 0.0
            self._tell(verdict, 0, found)
        return verdict

    def _is_rounded(self, a: np.ndarray, b: np.ndarray) -> bool:
        """Return whether a leg from beside a segment is free (decision 0102).

        What stands still may be nearer than the clearance by what rounding may spend.
        """
        static, dq = self.oracle.static, difference(self.cell_map.robot, a, b)
        nearer = static.safety.rounding
        free = static.motions_free(a[None], dq[None], nearer=nearer)[0]
        return free and self.oracle.blocked_leg(np.stack([a, a + dq])) is None

    def _refuses_a_place(
        self, ask: Callable[..., Freedom], a: np.ndarray, b: np.ndarray
    ) -> bool:
        """Return whether there is a place on a leg that the oracle refuses."""
        dq = difference(self.cell_map.robot, a, b)
        places = (a + t * dq for t in np.linspace(0.0, 1.0, PLACES))
        return not all(ask(q, q) for q in places)

    def _take_up(self, world: World) -> None:
        oracle, self._dirty = self.oracle, False
        self._stand_free.clear()
        if oracle.attached is not None:
            oracle.detach()
        if world.held is not None:
            oracle.attach(world.held)
        if not np.array_equal(oracle.world.T_world_base, world.T_world_base):
            oracle.set_base(world.T_world_base)
        if oracle.extra != world.extra:
            oracle.set_extra_clearance(world.extra)
        if self._things is not world.things:
            world.furnish(oracle)
            oracle.scene.test_waiting()
            self._things = world.things
        self._side = self._plain
        if world.held is not None:  # as solids; a planner's robot has its spheres alone
            robot = with_payload(self.cell_map.robot, world.held)
            self._side = _ExactSide(self.cell_map, robot)

    def _measure(
        self, world: World, path: np.ndarray, verdict: Verdict, spent: float
    ) -> None:
        """Measure each leg with exact solids.

        The first may be nearer by `spent` [m] to what stands still.
        """
        T = np.linalg.inv(world.T_world_base)
        m = self.cell_map.safety.m
        moving, things = world.solids(), [thing.moved(T) for thing in world.things]
        kept, verdict.exact = m + world.extra, True
        legs = list(enumerate(zip(path, path[1:], strict=False)))
        together = [*moving, *things]
        parts = [(together, legs, kept, m)]
        if spent:
            parts = [(together, legs[1:], kept, m), (moving, legs[:1], kept, m - spent)]
            parts.append((things, legs[:1], kept - spent, m - spent))
        for around, some, beside, own in parts:
            self._side.stand_around(around)
            for k, (a, b) in some:
                dq = difference(self.cell_map.robot, a, b)
                self._tell(verdict, k, self._side.leg(a, dq, beside, own))

    def _tell(self, verdict: Verdict, k: int, found: "_Found") -> None:
        if found.gap < verdict.gap:
            verdict.gap, verdict.distance = found.gap, found.distance
        if found.gap < -TOLERANCE or found.touches:
            verdict.wrong.append(
                f"leg {k}: exactly {1e3 * found.distance:.2f} mm from {found.what}"
                + (", in contact" if found.touches else "")
            )


def _capsules(rods: np.ndarray) -> list[Shape]:
    return [Capsule.between(row[:3], row[3:6], row[6]) for row in rods]


@dataclass
class _Found:
    gap: float
    distance: float
    what: str
    touches: bool = False


class _ExactSide:
    """Exact distances along legs of one robot, with or without something in hand."""

    def __init__(self, cell_map: CellMap, robot: Robot) -> None:
        self.exact, self.fcl = ExactRobot(robot), FclRobot(robot)
        self.motion_bounds = center_motion_bounds(cell_map.arm, robot.dof)
        scenery = cell_map.scenery
        self.scenery = []  # parts, their names, and which solids meet them
        moving = robot.link_body[robot.solid_link] > 0
        for row, name in zip(scenery.solids, scenery.names, strict=True):
            links = [robot.link_names.index(a) for a, b in scenery.dropped if b == name]
            use = moving & ~np.isin(robot.solid_link, links)
            part = obstacles_of([solid_of(row, scenery.faces)])
            self.scenery.append((part, name, use))

    def stand_around(self, shapes: list[Shape]) -> None:
        """Take the obstacles of a frame and the scenery of the place, base frame."""
        self.fcl.set_obstacles(shapes)
        self._near = obstacles_of(shapes) if shapes else None

    def distance(self, q: np.ndarray) -> float:
        """Return the exact distance at q from what stands around [m], FAR at most."""
        if self._near is None:
            return FAR
        return self.exact.distance(q, self._near, cap=FAR).distance

    def leg(self, q: np.ndarray, dq: np.ndarray, kept: float, m: float) -> _Found:
        """Return the smallest distance on q + t dq, less what must be kept.

        `kept` from what stands around [m], m from the map's own scenery.
        """
        best, near = _Found(np.inf, np.inf, "nothing"), self._near
        far = max(FAR, 2.0 * kept, 2.0 * m)
        bound = max(float(np.abs(dq) @ self.motion_bounds), 1e-12)
        t, k = 0.0, 0
        while True:
            at = q + t * dq
            here = np.inf
            if near is not None:
                found = self.exact.distance(at, near, cap=far)
                here = found.distance - kept
                best = _least(best, found.distance, kept, found.link)
            for part, name, use in self.scenery:
                found = self.exact.distance_of(use, at, part, far)
                here = min(here, found.distance - m)
                best = _least(best, found.distance, m, f"{name} ({found.link})")
            if k % EVERY == 0 or t == 1.0:
                own = self.exact.self_distance(at)
                best = _least(best, own.distance, 0.0, f"itself ({own.link})")
                best.touches |= near is not None and self.fcl.collides(at)
            if t == 1.0:
                return best
            t, k = min(1.0, t + max(here, STEP) / bound), k + 1


def _least(best: _Found, distance: float, kept: float, what: str) -> _Found:
    if distance - kept >= best.gap:
        return best
    return _Found(distance - kept, distance, what, best.touches)


def solid_of(row: np.ndarray, faces: np.ndarray) -> Shape:
    """Return the shape of a row of `Scenery.solids`: a large box for a half-space."""
    shape = shape_of_row(row, faces)
    if shape is not None:
        return shape
    normal, offset = row[1:4], row[4]
    T = pose_with(rotation_to_z(normal), (offset - 0.5 * GROUND) * normal)
    return Box(np.full(3, GROUND), T)

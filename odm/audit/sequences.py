"""Attack a planner by long sequences: does what it remembers ever free a motion?

A planner that lives long remembers: the path in use, motions that were attached,
shortcuts, where obstacles have been. A frame is random here in all that a caller may
do: obstacles come and go, goals are switched and kept, the robot follows, drifts, is
pushed, trembles and jumps, something is taken into the hand, the base moves, frames are
stale, broken or huge. After each frame every leg of the answer is judged by
`odm.audit.sequence_judge`, which remembers nothing; and where it holds, the way out
that it offers.
"""

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from odm.answer import HOLDING, IN_USE, REPLANNED, ROADMAP, SEARCH, STRAIGHT, Answer
from odm.audit.sequence_judge import SHAPES, SPACING, Judge, Verdict, World
from odm.cell_map.cell_map import CellMap
from odm.cell_map.recipe import PayloadRecipe
from odm.obstacles.obstacles import Obstacles, lent_arrays
from odm.obstacles.shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere
from odm.obstacles.surfaces import sample_capsules, surface_of
from odm.planner.planner import ReactivePlanner
from odm.planner.settings import PlannerSettings
from odm.search._paths import locate_on_path
from roadmap.errors import BadInput
from roadmap.kinematics.forward import sphere_centers, wrapped
from roadmap.transforms import moved_points, pose_of

PUSH = 0.006  # [m] how far a sphere is pushed in one frame, at most
FAR = (0.1, 0.5)  # [m] how far in all
AIMED = 0.8  # share of the pushes in whose way an obstacle is put
MISREAD = 0.004  # [rad or m] steady error of a joint, at most
FEW, HUGE = 4, 40_000  # goals at most; points of a frame that makes the memory grow
BUMP = 0.04  # [rad or m] of a joint
TRIED = 500  # configurations that are drawn before the scenery goes
PATIENCE = 12  # frames without a path, then the obstacles leave
WAYS_OUT = 4  # of so many frames in a row that hold, the first one's is judged
TOO_NEAR = 0.25  # share of the approaches to within what the cover keeps

# What happens between two frames, and how often relative to each other.
EVENTS = {
    "follow": 60, "push": 5, "misread": 2, "tremble": 6, "bump": 3, "jump": 1,
    "wait": 8, "improve": 25, "improve_ahead": 5, "switch_goals": 3, "keep_goals": 4,
    "costs": 1, "approach_robot": 20, "move_obstacles": 20, "clear": 1, "come": 6,
    "reset": 0.3, "hand": 0.4, "base": 0.15, "clearance": 0.3, "scenery": 1,
    "stale": 0.8, "broken": 0.8, "grow": 0.03, "prepare": 0.4,
}  # fmt: skip
QUIET = {"wait", "improve", "keep_goals", "tremble"}  # while the robot is being pushed

# What an answer may be: what found its path, and what stands about, and how it is told.
BESIDE, BY_LINKS, IMPROVED = "from beside its path", "by the links", "just improved"
HELD, POINTS = "something in the hand", "points about"
NAMED, LOOSE = "objects of the scene", "static scenery of points"
_ABOUT = {
    Capsule: "capsules about", Sphere: "spheres about", Cylinder: "cylinders about",
    Box: "boxes about", Mesh: "meshes about",
}  # fmt: skip
KINDS = (
    STRAIGHT, ROADMAP, SEARCH, IN_USE, IMPROVED, BESIDE, BY_LINKS, HELD, NAMED, LOOSE,
    POINTS, *_ABOUT.values(),
)  # fmt: skip
# A new path of these is measured exactly, always: else hardly any would be.
RARE = {SEARCH, BY_LINKS, HELD, NAMED, LOOSE, *_ABOUT.values()} - {_ABOUT[Capsule]}


@dataclass(frozen=True)
class Step:
    """One frame of a sequence: the answer, and what was found about its legs.

    Attributes:
        answer: The answer.
        verdict: Of its legs; None where it holds.
        kinds: What kinds of answer it is, of `KINDS`; none where it holds.
        way_out: Of the motion out that it offers, where it holds and that was judged.
    """

    answer: Answer
    verdict: Verdict | None
    kinds: tuple[str, ...] = ()
    way_out: Verdict | None = None


class Sequence:
    """The life of one planner, and of the robot and the obstacles around it.

    Args:
        cell_map: The map.
        seed: Same seed, same sequence.
        judge: Judges the answers; shared by sequences on one map.
        tamper: Called with the planner and q before each frame; the audit of the audit.
    """

    def __init__(
        self,
        cell_map: CellMap,
        seed: int,
        judge: Judge,
        tamper: Callable[[ReactivePlanner, np.ndarray], None] | None = None,
    ) -> None:
        self.cell_map, self.robot = cell_map, cell_map.robot
        self.rng = np.random.default_rng(seed)
        self.judge, self.tamper = judge, tamper
        kept = int(self.rng.integers(0, 3))
        many = PlannerSettings(point_capacity=4096, cached_goals=kept)
        self.planner = ReactivePlanner(
            cell_map,
            always_replan=bool(self.rng.random() < 0.15),
            settings=replace(many, tight_ends=kept == 1),
        )
        judge.begin()
        self.world = World(rho=cell_map.safety.rho)
        self.now = 0.0
        self.q = self.draw_valid()
        self.error = np.zeros(self.robot.dof)  # of the measured q
        self.pushed = np.zeros(self.robot.dof)  # in every frame
        self.pushes = 0  # frames in which that goes on
        self.velocity = np.zeros((2, 3))
        self.idle = 0
        self.is_broken = self.is_stale = False  # the next frame
        self.improved = False  # something was found since the last one
        self.answer: Answer | None = None
        self.switch_goals()

    # --- what is drawn ----------------------------------------------------------

    def draw_valid(self) -> np.ndarray:
        """Return a configuration that nothing standing still blocks.

        Where the scenery of this place leaves hardly any, it is taken away.
        """
        nodes, still = self.cell_map.roadmap.nodes, np.zeros(self.robot.dof)
        for tried in itertools.count():
            if tried and tried % TRIED == 0:
                self.world.things = []
                self._set_scenery()
            q = nodes[self.rng.integers(len(nodes))] + self.rng.normal(
                0.0, 0.1 if self.rng.random() < 0.8 else 0.0, self.robot.dof
            )
            q = self.inside(q)
            if self.planner.static.motion_free(q, still):
                return q

    def inside(self, q: np.ndarray) -> np.ndarray:
        """Return q moved inside the joints' limits."""
        return np.clip(wrapped(self.robot, q), self.robot.lower, self.robot.upper)

    def draw_shape(self, near: np.ndarray) -> Shape:
        """Return a sphere, cylinder, box or convex mesh beside `near` [m]."""
        rng = self.rng
        p = near + rng.normal(size=3) * 0.15
        T = pose_of(p, rng.uniform(-3.0, 3.0, 3))
        size = rng.uniform(0.02, 0.25, 3)
        kind = int(rng.integers(4))
        if kind == 0:
            return Sphere(float(0.4 * size[0]), T)
        if kind == 1:
            return Cylinder(float(0.3 * size[0]), float(size[1]), T)
        if kind == 2:
            return Box(size, T)
        top = np.append(0.4 * size[:2] * rng.normal(size=2), size[2])
        corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
        base = 0.5 * size * corners
        faces = [[0, 2, 1], [0, 3, 2], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]
        return Mesh(np.vstack([base, top]), np.array(faces), T)

    def draw_arm(self, near: np.ndarray | None = None) -> np.ndarray:
        """Return two capsules (2, 7) in the base frame, one through `near` [m]."""
        rng, grid = self.rng, self.cell_map.grid
        if near is None:
            low, high = grid.origin, grid.origin + 4 * grid.h * grid.blocks
            near = rng.uniform(low, high)
        out = rng.normal(size=3) * [1.0, 1.0, 0.5]
        elbow = near + out / max(np.linalg.norm(out), 1e-9) * 0.3
        shoulder = elbow + rng.normal(size=3) * 0.15 + [0.0, 0.0, 0.2]
        r = rng.uniform(0.02, 0.07)
        return np.array([[*near, *elbow, r], [*elbow, *shoulder, r + 0.01]])

    # --- what happens between frames --------------------------------------------

    def follow(self) -> None:
        """Move along the path that was answered, anywhere between nothing and far."""
        if self.pushes or self.answer is None or self.answer.status == HOLDING:
            return
        left = self.rng.choice([0.005, 0.02, 0.05, 0.3]) * self.rng.random()
        q = self.answer.path[0]
        for corner in self.answer.path[1:]:
            leg = corner - q
            length = float(np.abs(leg).max())
            if length > left:
                q = q + leg * (left / length)
                break
            left -= length
            q = corner
        self.q = self.inside(q + self.error)

    def push(self) -> None:
        """Begin to be pushed off the path, mostly against an obstacle."""
        rng, robot = self.rng, self.robot
        d = rng.normal(size=robot.dof)
        d /= self._motion(d)
        far, size = rng.uniform(*FAR), PUSH * 10.0 ** rng.uniform(-1.0, 0.0)
        self.pushed, self.pushes = size * d, 1 + int(far / size)
        if rng.random() > AIMED:
            return
        ends = self.q, self.inside(self.q + far * d)
        here, there = (sphere_centers(robot, q)[robot.moving] for q in ends)
        near = there[np.linalg.norm(there - here, axis=1).argmax()]
        for _ in range(FEW):
            arm = self.draw_arm(near)
            away = sample_capsules(arm, SPACING)[:, None] - here
            gap = np.linalg.norm(away, axis=2) - robot.spheres[robot.moving, 3]
            if gap.min() > self.planner.keep:
                self.world.capsules, self.world.others = arm, []
                return

    def _motion(self, dq: np.ndarray) -> float:
        """Return how far the fastest sphere moves at q, per unit of dq [m]."""
        small = 1e-4
        here, there = (sphere_centers(self.robot, self.q + s * dq) for s in (0, small))
        return max(float(np.linalg.norm(there - here, axis=1).max()) / small, 1e-3)

    def misread(self) -> None:
        """Begin to measure with a steady error, or right again."""
        scale = MISREAD * self.rng.choice([0.0, 0.02, 0.2, 1.0])
        self.error = self.rng.uniform(-scale, scale, self.robot.dof)

    def tremble(self) -> None:
        """Measure with noise."""
        scale = self.rng.choice([1e-9, 1e-6, 1e-4, 1e-3])
        self.q = self.inside(self.q + self.rng.normal(0.0, scale, self.robot.dof))

    def bump(self) -> None:
        """Be pushed by a lot at once."""
        push = self.rng.uniform(-BUMP, BUMP, self.robot.dof)
        self.q = self.inside(self.q + push)

    def jump(self) -> None:
        """Stand somewhere else: the robot was moved between two frames."""
        self.q = self.draw_valid()

    def wait(self) -> None:
        """Stay."""

    def improve(self) -> None:
        """Improve the path in use."""
        self.improved |= self.planner.improve(int(self.rng.integers(0, 13))) > 0

    def improve_ahead(self) -> None:
        """Improve it from a place that the robot will come to, or just not."""
        if self.answer is None or self.answer.status == HOLDING:
            return
        a, b = self.answer.path[:2]
        ahead = a + self.rng.random() * (b - a)
        if self.rng.random() < 0.3:
            ahead = ahead + self.rng.normal(0.0, 1e-3, self.robot.dof)
        made = self.planner.improve(int(self.rng.integers(0, 13)), ahead)
        self.improved |= made > 0

    def switch_goals(self) -> None:
        """Set other goals, sometimes some of the old ones with them."""
        old = [g for g in self.planner.goals if self.rng.random() < 0.3]
        new = [self.draw_valid() for _ in range(1 + self.rng.integers(FEW))]
        self._set_goals([*new, *old], None)

    def keep_goals(self) -> None:
        """Set the goals again, in another order."""
        goals = list(self.planner.goals)
        self.rng.shuffle(goals)
        self._set_goals(goals, self.planner.costs)

    def costs(self) -> None:
        """Let the goals' costs count."""
        goals = list(self.planner.goals)
        self._set_goals(goals, self.rng.uniform(0.0, 2.0, len(goals)))

    def _set_goals(self, goals: list, costs: np.ndarray | None) -> None:
        if not goals:
            return
        try:
            self.planner.set_goals(goals, costs)
        except BadInput:  # the scenery of this place, or what the hand holds, is there
            pass

    def prepare(self) -> None:
        """Attach a goal ahead."""
        try:
            self.planner.prepare_goal(self.draw_valid())
        except BadInput:
            pass

    def move_obstacles(self) -> None:
        """Let the obstacles go on."""
        self.velocity += self.rng.normal(0.0, 0.002, self.velocity.shape)
        self.velocity *= 0.9
        if len(self.world.capsules):
            self.world.capsules[:, :3] += self.velocity[0]
            self.world.capsules[:, 3:6] += self.velocity[1]
            self._carry_others(self.velocity[0])

    def approach_robot(self) -> None:
        """Let the obstacles come as near to what lies ahead as they just may.

        Or a little nearer to the cover: the links may yet be free, and who holds may be
        offered a way out.
        """
        if len(self.world.capsules):
            q, keep = self._ahead(), self._keep()
            if self.rng.random() < TOO_NEAR:
                self._shift(q, keep - self.rng.uniform(0.0, 0.02))
            else:
                self._shift(q, keep + 10.0 ** self.rng.uniform(-4.0, -1.5))

    def _keep(self) -> float:
        """Return what the cover keeps from the obstacles, as they are told [m]."""
        frame = self.planner.frame
        if self.world.mode == "shapes":
            return frame.keep_from_shapes
        return frame.keep

    def come(self) -> None:
        """Let obstacles appear, mostly beside what lies ahead."""
        self.velocity = self.rng.normal(0.0, 0.002, (2, 3))
        modes = ["rho", "rho", "round", "dense", "shapes", "shapes", "both"]
        self.world.mode = str(self.rng.choice(modes))
        self.world.others = []
        if self.rng.random() < 0.2:
            self.world.capsules = self.draw_arm()
            return
        q = self._ahead()
        centers = sphere_centers(self.robot, q)[self.robot.moving]
        beside = self.rng.normal(size=3)
        beside *= 0.3 / max(float(np.linalg.norm(beside)), 1e-9)
        near = centers[self.rng.integers(len(centers))] + beside
        self.world.capsules = self.draw_arm(near)
        if self.world.mode in SHAPES:
            number = int(self.rng.integers(0, 4))
            self.world.others = [self.draw_shape(near) for _ in range(number)]
        self._shift(q, self._keep() + self.rng.uniform(0.0, 0.12))

    def _ahead(self) -> np.ndarray:
        """Return a configuration of the path, more often a near one; or q."""
        if self.answer is None or self.answer.status == HOLDING:
            return self.q
        path = self.answer.path
        k = 0 if self.rng.random() < 0.6 else int(self.rng.integers(len(path) - 1))
        return path[k] + self.rng.random() * (path[k + 1] - path[k])

    def _shift(self, q: np.ndarray, gap: float) -> None:
        """Move the obstacles straight until they are so far from the cover at q [m]."""
        capsules = self.world.capsules
        points = sample_capsules(capsules, SPACING)
        if self.world.mode in SHAPES:
            parts = [surface_of(s, SPACING).points for s in self.world.others]
            points = np.concatenate([points, *parts])
        step = self._step_to(points, q, gap)
        capsules[:, :3] += step
        capsules[:, 3:6] += step
        self._carry_others(step)

    def _step_to(self, points: np.ndarray, q: np.ndarray, gap: float) -> np.ndarray:
        """Return (3,) by which points come to be so far from the cover at q [m]."""
        robot = self.robot
        centers = sphere_centers(robot, q)[robot.moving]
        radii = robot.spheres[robot.moving, 3]
        away = points[:, None] - centers
        length = np.linalg.norm(away, axis=2)
        i, k = np.unravel_index(np.argmin(length - radii), length.shape)
        now = length[i, k] - radii[k]
        return (gap - now) / max(float(length[i, k]), 1e-9) * away[i, k]

    def _carry_others(self, step: np.ndarray) -> None:
        """Move the other obstacles straight [m]."""
        T = pose_of(step)
        self.world.others = [shape.moved(T) for shape in self.world.others]

    def clear(self) -> None:
        """Let the obstacles leave."""
        self.world.capsules = np.zeros((0, 7))
        self.world.others = []

    def reset(self) -> None:
        """Forget the path in use."""
        self.planner.reset()
        self.answer = None

    def hand(self) -> None:
        """Take something into the hand, or let go of it."""
        layer = self.cell_map.payload
        if layer is None:
            return
        if self.world.held is not None:
            self.planner.detach()
            self.world.held = None
        else:
            held = _drawn_inside(layer.recipe, self.rng)
            self.planner.attach(held)
            self.world.held = held
        self.judge.changed()

    def base(self) -> None:
        """Move the base."""
        p = self.rng.uniform([-0.3, -0.3, 0.0], [0.3, 0.3, 0.1])
        self.world.T_world_base = pose_of(p, (0.0, 0.0, self.rng.uniform(-0.5, 0.5)))
        self.planner.set_base(self.world.T_world_base)
        self.judge.changed()

    def clearance(self) -> None:
        """Keep more or less distance."""
        self.world.extra = float(self.rng.choice([0.0, 0.0, 0.01, 0.04]))
        self.planner.set_extra_clearance(self.world.extra)
        self.judge.changed()

    def scenery(self) -> None:
        """Put things around what lies ahead, by name or for good, or take all away.

        One in two stands as near to it as it just may: the robot may leave its path.
        """
        rng = self.rng
        self.world.things, self.world.named = [], bool(rng.random() < 0.5)
        keep = self.planner.frame.keep_from_shapes
        keep += 0.0 if self.world.named else self.world.rho
        if rng.random() < 0.8:
            q = self._ahead()
            centers = sphere_centers(self.robot, q)[self.robot.moving]
            for _ in range(int(rng.integers(1, 4))):
                away = rng.normal(size=3)
                away *= rng.uniform(0.1, 0.5) / max(float(np.linalg.norm(away)), 1e-9)
                thing = self.draw_shape(centers[rng.integers(len(centers))] + away)
                if rng.random() < 0.5:
                    gap = keep + 10.0 ** rng.uniform(-4.0, -2.0)
                    points = surface_of(thing, 0.5 * SPACING).points
                    thing = thing.moved(pose_of(self._step_to(points, q, gap)))
                # they stand in the world
                self.world.things.append(thing.moved(self.world.T_world_base))
        self._set_scenery()

    def _set_scenery(self) -> None:
        self.world.furnish(self.planner)
        self.judge.changed()

    def stale(self) -> None:
        """Let the next frame be too old, or older than the one before."""
        self.is_stale = True

    def broken(self) -> None:
        """Let the next frame hold NaN."""
        self.is_broken = True

    def grow(self) -> None:
        """Let the memory grow by a frame of very many points."""
        if len(self.world.capsules):
            self.world.repeat = HUGE

    # --- a frame ----------------------------------------------------------------

    def frame(self, exact: bool = False) -> Step:
        """Ask the planner for one frame and judge what it says."""
        self.now += 0.01
        world, given = self.world, self.world.given()
        seen, stamp = given, self.now
        late = self.is_stale * float(self.rng.choice([0.05, 0.5]))
        stamp -= late  # a little: to be refused if it is older than the frame before
        there = len(given) > 0  # of obstacles the number of shapes, of points theirs
        if self.is_broken and there:
            given = self._broken(given)
        refused = late > 0.1 or (self.is_broken and there)
        self.is_stale = self.is_broken = False
        if self.tamper is not None:
            self.tamper(self.planner, self.q)
        answer = self.planner.step(
            given, q=self.q, stamp=stamp, now=self.now, **world.step_arguments()
        )
        verdict = way_out = None
        kinds: tuple[str, ...] = ()
        if answer.status != HOLDING:
            beside = self.planner.memory.numbers.off_path.item() == 1
            kinds = tuple(self._kinds(answer, beside))
            exact |= answer.status == REPLANNED and not RARE.isdisjoint(kinds)
            told = answer.path, exact, answer.by_links
            verdict = self.judge.judge(world, seen, self.q, *told, beside)
            if refused:
                verdict.wrong.append("a frame that cannot be used was answered")
        elif self.idle % WAYS_OUT == 0 and answer.retreat is not None:
            way_out = self.judge.judge_way_out(world, seen, self.q, answer.retreat)
            if refused:
                way_out.wrong.append("a frame that cannot be used offers a way out")
        self.answer, self.improved = answer, False
        self.idle = self.idle + 1 if answer.status == HOLDING else 0
        if self.idle > PATIENCE:
            self.clear()
            self.pushes = self.idle = 0
            self.q = self.draw_valid()
        if self.pushes:
            self.pushes -= 1
            self.q = self.inside(self.q + self.pushed)
        return Step(answer, verdict, kinds, way_out)

    def _kinds(self, answer: Answer, beside: bool) -> Iterator[str]:
        """Yield of what kinds an answer with a path is."""
        world, told = self.world, {type(shape) for shape in self.world.shapes()}
        yield answer.stage
        about = {
            IMPROVED: self.improved and answer.stage == IN_USE,
            BESIDE: beside,
            BY_LINKS: len(answer.by_links) > 0,
            HELD: world.held is not None,
            NAMED: world.named and len(world.things) > 0,
            LOOSE: not world.named and len(world.things) > 0,
            POINTS: len(world.capsules) > 0 and world.mode != "shapes",
        }
        about |= {name: kind in told for kind, name in _ABOUT.items()}
        yield from (name for name, holds in about.items() if holds)

    def _broken(self, given: np.ndarray | Obstacles) -> np.ndarray | Obstacles:
        """Return what is given with one value that is no number."""
        if isinstance(given, Obstacles):
            rows, _ = lent_arrays(given)
            rows[self.rng.integers(len(rows))] = np.nan
            return given
        given = given.copy()
        given[self.rng.integers(len(given)), self.rng.integers(3)] = np.nan
        return given

    def run(self, steps: int, exact_every: int) -> Iterator[Step]:
        """Run so many frames with random events between them, one at a time."""
        names = list(EVENTS)
        share = np.array(list(EVENTS.values()))
        share = share / share.sum()
        for k in range(steps):
            for _ in range(1 + int(self.rng.integers(3))):
                drawn = int(self.rng.choice(len(names), p=share))
                if not self.pushes or names[drawn] in QUIET or self.rng.random() < 0.02:
                    getattr(self, names[drawn])()
            yield self.frame(exact=k % exact_every == 0)


def reuse_certificate(planner: ReactivePlanner, q: np.ndarray) -> None:
    """Let the certificate of the segment in use count for the motion from q off it.

    What an earlier version did: a robot off its segment by no more than the tracking
    share was taken to be on it. The motion from there got the segment's cells and its
    mark of being free of what stands still, and the next frame measured from it. What
    the segment had to spare counts for that motion, too: most have no cells, and are
    tested anew where that is used up. The planner is about to be asked from q.
    """
    robot_state, path = planner.memory.robot_state, planner.memory.path
    if not np.isfinite(q).all():
        return
    at = int(locate_on_path(planner.memory.table, path, 0, q, robot_state.fraction))
    if at >= 0:
        certificates, slacks = planner.memory.certificates, planner.memory.slacks
        now, kept = (q, path.q[at + 1].copy()), slacks.chords > 0
        for old, held in (
            (certificates.begin, slacks.begin),
            (certificates.end, slacks.end),
        ):
            kept &= np.abs(held - old[at]).max(axis=1) < 1e-9
        slacks.begin[kept], slacks.end[kept] = now
        path.q[at] = q
        certificates.begin[at], certificates.end[at] = now


def _drawn_inside(envelope: PayloadRecipe, rng: np.random.Generator) -> np.ndarray:
    """Return spheres (n, 4) of an object that the payload envelope contains [m].

    In a box they reach from end to end of its longest side.
    """
    sides = np.array(envelope.size or [2.0 * envelope.radius] * 3)
    room = 0.5 * sides.min()
    radius = min(room, 0.5 * room * rng.random() + 0.01)
    along = np.zeros((1, 3))
    if envelope.size:
        ends = np.linspace(radius, sides.max() - radius, 5) - 0.5 * sides.max()
        along = ends[:, None] * (np.arange(3) == sides.argmax())
    centers = moved_points(along, pose_of(envelope.position, envelope.rpy))
    return np.column_stack([centers, np.full(len(centers), radius)])

"""Frames of the reference set-up: a person's arm between two places of the robot.

An arm of two capsules (upper arm 0.30 m, radius 0.05; forearm with hand 0.43 m, radius
0.04) hangs on a shoulder about 0.85 m before the robot. In each pair the robot wants to
go from one side of the arm to the other, and the hand sweeps, reaches or trembles
between them at up to 1 m/s, seen at 100 Hz. Everything comes from the seed.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from odm import Answer, Capsule, Obstacles, ReactivePlanner, sample_capsules
from odm.cell_map.cell_map import CellMap
from odm.close_test.static import StaticTest
from odm.exact.distances import ExactRobot
from roadmap.arrays import frozen
from roadmap.errors import PlanningError
from roadmap.kinematics.forward import difference, tool_pose

LENGTHS = (0.30, 0.43)  # upper arm, forearm with hand: axes of the capsules [m]
RADII = (0.05, 0.04)
ROUND = min(RADII)  # told to the planner: capsules of no smaller radius [m]
SPACING = 0.03  # covering radius of the arm's samples [m]
RATE_HZ = 100.0
TOP_SPEED = 1.0  # of any point of the arm [m/s]
MOTIONS = ("sweep", "reach", "jitter")
MORE_MOTIONS = ("hover", "intrusion", "crowding")  # for comparisons with peers
_SPEEDS = {"hover": 0.15, "intrusion": 2.0}  # where it is not TOP_SPEED [m/s]
CONDITIONS = {
    "every": "the exact solids keep the clearance m from the arm in every frame",
    "clear": "the cover keeps rho + m from the arm's samples in every frame",
    "first": "the exact solids keep the clearance m from the arm in the first frame",
}
# where the tool starts and ends: left and right of the arm [m]
SIDE = np.array([[0.25, 0.15, 0.15], [0.65, 0.55, 0.75]])
_MOST_DRAWS = 5000
# a straight motion is looked at in so many frames, so far apart [rad or m]
_LOOKS, _LOOK_STEP = 20, 0.1


class NoFeasiblePair(PlanningError):
    """The robot has no valid configurations at the two sides of the arm."""


@dataclass(frozen=True, eq=False)
class Pair:
    """One start and goal, and the frames between which they are asked for.

    Attributes:
        q_start, q_goal: (dof,) valid configurations, not roadmap nodes.
        capsules: (f, k, 7) the arm, or both arms, in every frame: a, b, radius [m].
        motion: How the hand moves: one of MOTIONS or MORE_MOTIONS.
    """

    q_start: np.ndarray
    q_goal: np.ndarray
    capsules: np.ndarray
    motion: str

    def __post_init__(self) -> None:
        for name in ("q_start", "q_goal", "capsules"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))

    def points(self) -> list[np.ndarray]:
        """Return the sampled surface of the arm in every frame, (n, 3) each [m]."""
        return [sample_capsules(rods, SPACING) for rods in self.capsules]

    def asked(
        self, shapes: bool = True
    ) -> list[Callable[[ReactivePlanner, np.ndarray], Answer]]:
        """Return for every frame what asks a planner for a path from q.

        With shapes the capsules are written into the obstacles, which counts as a part
        of the frame; without, the samples are at hand.
        """
        if not shapes:
            return [partial(_ask_of_points, points) for points in self.points()]
        obstacles = Obstacles(capsules=self.capsules.shape[1])
        return [partial(_ask_of_shapes, obstacles, rods) for rods in self.capsules]

    def begin(
        self,
        planner: ReactivePlanner,
        ask: Callable[[ReactivePlanner, np.ndarray], Answer],
    ) -> None:
        """Let a planner answer the first frame, which pays for a q never seen."""
        planner.reset()
        planner.set_goals([self.q_goal])
        ask(planner, self.q_start)

    def part(self, frames: slice) -> "Pair":
        """Return the pair with some of its frames only."""
        return Pair(self.q_start, self.q_goal, self.capsules[frames], self.motion)


def _ask_of_shapes(
    obstacles: Obstacles, rods: np.ndarray, planner: ReactivePlanner, q: np.ndarray
) -> Answer:
    obstacles.capsules[:] = rods
    return planner.step(obstacles, q=q)


def _ask_of_points(
    points: np.ndarray, planner: ReactivePlanner, q: np.ndarray
) -> Answer:
    return planner.step(points, q=q, rounding=ROUND)


def make_pairs(
    cell_map: CellMap,
    pairs: int = 60,
    frames: int = 200,
    seed: int = 1,
    condition: str = "every",
    sided: bool = True,
    motions: tuple[str, ...] = MOTIONS,
    blocked: float = 0.0,
) -> list[Pair]:
    """Draw pairs of configurations and a moving arm for each.

    Args:
        cell_map: The map of the robot.
        pairs: Number of pairs.
        frames: Number of frames of each.
        seed: Same seed, same frames.
        condition: What start and goal must be, see CONDITIONS. "every" is how the
            competitors of GOALS were measured, and does not depend on how tight
            cover and samples are; "clear" is what the planner calls free.
        sided: Start and goal have the tool on either side of the arm; False: they
            are any valid configurations.
        motions: Of the hand, in turn.
        blocked: In this share of a pair's frames, or more, the arm comes nearer than
            the clearance m to the straight motion, by exact geometry; in as large a
            one as was found, where none was in many draws.

    Raises:
        NoFeasiblePair: None was found in many draws.
    """
    draw = _Draw(cell_map, np.random.default_rng(seed), sided, blocked)
    return [
        draw.pair(motions[k % len(motions)], frames, condition) for k in range(pairs)
    ]


class _Draw:
    """Draws pairs for one map from one stream of random numbers."""

    def __init__(
        self,
        cell_map: CellMap,
        rng: np.random.Generator,
        sided: bool,
        blocked: float = 0.0,
    ) -> None:
        self.robot, self.rng, self.blocked = cell_map.robot, rng, blocked
        self.m = cell_map.safety.m
        self.exact = ExactRobot(cell_map.robot)
        self.planner = ReactivePlanner(cell_map)
        self.sided = sided
        self.keep = cell_map.safety.rho + cell_map.safety.m
        self.static = StaticTest(
            self.robot, cell_map.scenery, cell_map.safety, cell_map.grid, threads=1
        )

    def pair(self, motion: str, frames: int, condition: str) -> Pair:
        most, best = 0.0, None
        for _ in range(200):
            capsules = arm_frames(motion, frames, self.rng)
            counted_capsules = capsules[:1] if condition == "first" else capsules
            free = self.clear if condition == "clear" else self.free
            q_start, q_goal = self.configuration(1.0), self.configuration(-1.0)
            if not (free(q_start, counted_capsules) and free(q_goal, counted_capsules)):
                continue
            if self.rng.random() < 0.5:
                q_start, q_goal = q_goal, q_start
            pair = Pair(q_start, q_goal, capsules, motion)
            share = self.share_blocked(pair) if self.blocked else 0.0
            if share >= self.blocked:
                return pair
            if best is None or share > most:
                most, best = share, pair
        if best is not None:
            return best
        raise NoFeasiblePair(
            f"no free pair of configurations was found for {self.robot.name} on both "
            "sides of the arm; the frames need a robot that can keep out of its way"
        )

    def configuration(self, side: float) -> np.ndarray:
        """Return a valid configuration with the tool at a side of the arm.

        A robot whose tool never gets there, as a planar one, may have it anywhere.
        """
        robot = self.robot
        ends = SIDE * [1.0, side, 1.0]
        low, high = ends.min(axis=0), ends.max(axis=0)
        for _ in range(_MOST_DRAWS):
            q = self.rng.uniform(robot.lower, robot.upper)
            p_tool = tool_pose(robot, q)[:3, 3]
            if self.sided and not ((low <= p_tool) & (p_tool <= high)).all():
                continue
            if self.static.motion_free(q, np.zeros(robot.dof)):
                return q
        if self.sided:
            self.sided = False
            return self.configuration(side)
        raise NoFeasiblePair(
            f"no valid configuration of {robot.name} was found in {_MOST_DRAWS} draws; "
            "check its recipe's scenery"
        )

    def free(self, q: np.ndarray, capsules: np.ndarray) -> bool:
        """Return whether the exact solids keep the clearance in all frames."""
        return all(all_keep(self.exact, q[None], c, self.m) for c in capsules)

    def share_blocked(self, pair: Pair) -> float:
        """Return the share of the frames in which the straight motion is blocked."""
        dq = difference(self.robot, pair.q_start, pair.q_goal)
        pieces = max(2, int(np.ceil(np.abs(dq).max() / _LOOK_STEP)))
        shares = np.linspace(0.0, 1.0, pieces + 1)[1:-1, None]
        places = pair.q_start + shares * dq
        some = pair.capsules[:: max(1, len(pair.capsules) // _LOOKS)]
        kept = [all_keep(self.exact, places, rods, self.m) for rods in some]
        return float(np.mean(np.logical_not(kept)))

    def clear(self, q: np.ndarray, capsules: np.ndarray) -> bool:
        """Return whether the planner calls q free in all frames."""
        for rods in capsules:
            self.planner.step(sample_capsules(rods, SPACING), q=q)
            if self.planner.separation(q) <= self.keep:
                return False
        return True


def all_keep(exact: ExactRobot, places: np.ndarray, rods: np.ndarray, m: float) -> bool:
    """Return whether the solids keep m from capsules (k, 7) at all places (n, dof)."""
    arm = shapes(rods)
    return not any(exact.collides(q, arm, m) for q in places)


def shapes(rods: np.ndarray) -> list[Capsule]:
    """Return capsules (k, 7) as solids."""
    return [Capsule.between(r[:3], r[3:6], r[6]) for r in rods]


def arm_frames(motion: str, frames: int, rng: np.random.Generator) -> np.ndarray:
    """Return the arm in every frame of a motion, (frames, 2, 7) [a, b, radius] [m].

    Crowding is two arms, (frames, 4, 7): one that sweeps, one that reaches.
    """
    if motion == "crowding":
        arms = [_one_arm(how, frames, rng) for how in ("sweep", "reach")]
        return np.concatenate(arms, axis=1)
    return _one_arm(motion, frames, rng)


def _one_arm(motion: str, frames: int, rng: np.random.Generator) -> np.ndarray:
    shoulder = np.array([0.85, 0.0, 0.45]) + rng.uniform(-0.1, 0.1, 3)
    path = _HANDS[motion](rng)
    swivel = rng.uniform(-0.6, 0.6)
    speed = _SPEEDS.get(motion, TOP_SPEED) * rng.uniform(0.5, 1.0)
    phase = rng.uniform()
    # the fastest point of the arm sets the time scale of the periodic motion
    s = np.linspace(0.0, 1.0, 2001)
    ends = _pose(shoulder, path(s), swivel)
    fastest = np.linalg.norm(np.diff(ends, axis=0), axis=-1).max() * 2000
    s = phase + np.arange(frames) / RATE_HZ * speed / fastest
    ends = _pose(shoulder, path(s), swivel)
    rods = np.empty((frames, 2, 7))
    rods[:, :, :3], rods[:, :, 3:6] = ends[:, :2], ends[:, 1:]
    rods[:, :, 6] = RADII
    return rods


def _pose(shoulder: np.ndarray, hand: np.ndarray, swivel: float) -> np.ndarray:
    """Return (f, 3, 3): shoulder, elbow and hand; the elbow hangs, turned by swivel."""
    a, b = LENGTHS
    reach = hand - shoulder
    far = np.linalg.norm(reach, axis=1)[:, None]
    along = reach / far
    far = np.clip(far, abs(a - b) + 0.02, a + b - 1e-3)
    hand = shoulder + far * along
    down = np.array([0.0, np.sin(swivel), -np.cos(swivel)])
    side = down - (along @ down)[:, None] * along
    side /= np.linalg.norm(side, axis=1)[:, None]
    x = (far**2 + a * a - b * b) / (2.0 * far)
    elbow = shoulder + x * along + np.sqrt(np.maximum(0.0, a * a - x * x)) * side
    return np.stack([np.broadcast_to(shoulder, hand.shape), elbow, hand], axis=1)


def _sweep(rng: np.random.Generator):  # noqa: ANN202 (share -> hand)
    middle = np.array([rng.uniform(0.30, 0.55), rng.uniform(-0.1, 0.1), 0.0])
    middle[2] = rng.uniform(0.3, 0.65)
    width = np.array([0.05, rng.uniform(0.25, 0.4), 0.1]) * rng.uniform(0.7, 1.0, 3)
    return lambda s: middle + width * np.sin(2 * np.pi * s)[:, None]


def _reach(rng: np.random.Generator):  # noqa: ANN202 (share -> hand)
    there = np.array([0.3, 0.0, 0.5]) + rng.uniform(-1, 1, 3) * [0.08, 0.15, 0.15]
    rest = np.array([0.7, 0.0, 0.15]) + rng.uniform(-0.05, 0.05, 3)
    way = there - rest
    return lambda s: rest + way * (0.5 - 0.5 * np.cos(2 * np.pi * s))[:, None]


def _jitter(rng: np.random.Generator):  # noqa: ANN202 (share -> hand)
    middle = np.array([0.42, 0.0, 0.5]) + rng.uniform(-1, 1, 3) * [0.12, 0.12, 0.15]
    turns, shift = rng.integers(1, 9, (4, 3)), rng.uniform(0, 1, (4, 3))
    size = rng.uniform(0.002, 0.012, (4, 3))

    def hand(s: np.ndarray) -> np.ndarray:
        angle = 2 * np.pi * (s[:, None, None] * turns + shift)
        return middle + (size * np.sin(angle)).sum(axis=1)

    return hand


def _hover(rng: np.random.Generator):  # noqa: ANN202 (share -> hand)
    """A hand that stays near one place and drifts slowly."""
    middle = np.array([0.45, 0.0, 0.45]) + rng.uniform(-1, 1, 3) * [0.1, 0.15, 0.15]
    size = rng.uniform(0.03, 0.08, 3)
    shift = rng.uniform(0, 1, 3)
    return lambda s: middle + size * np.sin(2 * np.pi * (s[:, None] + shift))


def _intrusion(rng: np.random.Generator):  # noqa: ANN202 (share -> hand)
    """A hand that rests beside the robot, shoots in, and goes back."""
    there = np.array([0.35, 0.0, 0.45]) + rng.uniform(-1, 1, 3) * [0.08, 0.12, 0.12]
    rest = np.array([0.8, 0.0, 0.9]) + rng.uniform(-0.05, 0.05, 3)

    def hand(s: np.ndarray) -> np.ndarray:
        share = np.clip(1.0 - 4.0 * np.abs(np.mod(s, 1.0) - 0.5), 0.0, 1.0)
        return rest + (there - rest) * (share * share * (3 - 2 * share))[:, None]

    return hand


_HANDS = {
    "sweep": _sweep,
    "reach": _reach,
    "jitter": _jitter,
    "hover": _hover,
    "intrusion": _intrusion,
}

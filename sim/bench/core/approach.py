"""`odm bench approach`: 15 cm into bins around the hand, found or not, and how long.

A bin is five boards around what the tool's body carries, so that the nearest board is
`spare` away from it at the pose; exact geometry says how much is really spared on the
whole line. The planner sees the boards' samples only. A board may come near to another
link: of a pose that is not found, exact geometry is asked about many configurations
that reach it, whether any of them keeps `spare`.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from odm import Box, ReactivePlanner, load_map, surface_of
from odm.approach.approach_answer import Approach
from odm.exact.distances import ExactRobot, obstacles_of
from odm.obstacles.surfaces import box_faces
from roadmap.kinematics.forward import tool_pose
from roadmap.robot.robot import Robot
from sim.bench.clock import Clock
from sim.tables.header import header
from sim.tables.table import value_row

WAY = 0.15  # [m]
DEPTH = 0.10  # [m] of the bin, above the tool
WALL = 0.02  # [m]
SPARES = (0.02, 0.03)  # [m]
SAMPLINGS = (
    ("faces, 0.5 cm", 0.005, True),
    ("faces, 1 cm", 0.01, True),
    ("surface, 0.5 cm", 0.005, False),
    ("surface, 1 cm", 0.01, False),
)
_SAMPLES = 8  # of each leg, for the exact distance
_SEEDS = 100  # of inverse kinematics, where no approach was found
_ROUNDING = 5e-4  # [m] the boards are `spare` away: nothing keeps a hair more


def run(
    map_dir: str | Path,
    *,
    seed: int = 0,
    short: bool = False,
    tell: Callable[[str], None] | None = None,
) -> dict:
    """Measure approaches with a map.

    Args:
        map_dir: Folder of a built map.
        seed: Of the poses.
        short: Few poses: to see that it runs, not to measure.
        tell: Called with what is measured.

    Returns:
        Plain data for JSON: "header", "setup" and "rows".
    """
    cell_map = load_map(map_dir, verify=False)
    planner = ReactivePlanner(cell_map)
    poses = free_poses(planner, 3 if short else 20, seed)
    rows, exact = [], ExactRobot(cell_map.robot)
    for spare in SPARES[:1] if short else SPARES:
        for name, spacing, by_face in SAMPLINGS[:1] if short else SAMPLINGS:
            label = f"{100 * spare:g} cm to spare, {name}"
            if tell:
                tell(label)
            rows += _measure(planner, exact, poses, spare, spacing, by_face, label)
    setup = {
        "poses": len(poses),
        "seed": seed,
        "tool's way": f"{100 * WAY:g} cm",
        "bin's depth above the tool": f"{100 * DEPTH:g} cm",
        "first call": "not counted, it prepares the finer cover",
    }
    return {
        "bench": "approach", "header": header(cell_map), "setup": setup, "rows": rows,
    }  # fmt: skip


def _measure(planner, exact, poses, spare, spacing, by_face, label) -> list[dict]:
    clock, found, spared, allowed = Clock(), [], [], []
    for q, T in poses:
        boards = bin_around(planner.robot, T, spare)
        sampled = [(box_faces if by_face else surface_of)(b, spacing) for b in boards]
        points = np.concatenate([s.points for s in sampled])
        rounding = np.inf if by_face else None
        planner.step(points, q, covering_radius=spacing, rounding=rounding)
        answer = clock(planner.approach, T, distance=WAY)
        found.append(bool(answer))
        if answer:
            spared.append(least_gap(exact, answer, boards))
        least = spare - _ROUNDING
        allowed.append(bool(answer) or largest_gap(planner, exact, T, boards) >= least)
    share = 100.0 * np.mean(found) if found else np.nan
    gap = 100.0 * min(spared) if spared else np.nan
    fair = 100.0 * sum(found) / sum(allowed) if any(allowed) else np.nan
    return [
        value_row(f"{label}: found", share, "%"),
        value_row(f"{label}: found where exact geometry allows it", fair, "%"),
        value_row(f"{label}: least exact gap of those", gap, "cm"),
        clock.row(label, p99=5000),
    ]


def free_poses(
    planner: ReactivePlanner, n: int, seed: int
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return n (q, T_base_tool), tool downwards, that are reached with nobody there."""
    rng, found = np.random.default_rng(seed), []
    nodes = np.array(planner.cell_map.roadmap.nodes)
    q = nodes[0]
    planner.step(np.zeros((0, 3)), q)
    for k in rng.permutation(len(nodes)):
        if len(found) == n:
            break
        T = tool_pose(planner.robot, nodes[k])
        T[:3, :3] = _downwards(T[:3, :3])
        if T[2, 3] > 0.1 and planner.approach(T, distance=WAY):
            found.append((q, T))
    return found


def _downwards(R: np.ndarray) -> np.ndarray:
    x = np.array([R[0, 0], R[1, 0], 0.0])
    length = np.linalg.norm(x)
    x = x / length if length > 1e-6 else np.array([1.0, 0.0, 0.0])
    z = np.array([0.0, 0.0, -1.0])
    return np.column_stack([x, np.cross(z, x), z])


def bin_around(robot: Robot, T_base_tool: np.ndarray, spare: float) -> list[Box]:
    """Return four walls and a bottom around what the tool's body carries.

    Args:
        robot: The robot; its tool's body has hulls.
        T_base_tool: (4, 4) where the tool ends; the bin opens against its z [m].
        spare: Distance of each board from the box around those solids [m].
    """
    own = robot.link_body[robot.solid_link] == robot.tip_body
    clouds = [_corners(robot, i) for i in np.flatnonzero(own)]
    T = robot.T_body_tip
    points = (np.concatenate(clouds) - T[:3, 3]) @ T[:3, :3]
    points = points[points[:, 2] > -DEPTH - spare]  # what enters the bin, or nearly
    low, high = points.min(axis=0) - spare, points.max(axis=0) + spare
    low[2] = -DEPTH
    boards = []
    for axis, sides in ((0, (-1, 1)), (1, (-1, 1)), (2, (1,))):
        for side in sides:
            size = high - low
            size[[k for k in (0, 1) if k != axis]] += 2 * WALL
            middle = 0.5 * (low + high)
            middle[axis] += side * 0.5 * (high[axis] - low[axis] + WALL)
            size[axis] = WALL
            pose = np.eye(4)
            pose[:3, 3] = middle
            boards.append(Box(size, T_base_tool @ pose))
    return boards


def _corners(robot: Robot, i: int) -> np.ndarray:
    points = robot.solid_points[robot.solid_ptr[i] : robot.solid_ptr[i + 1]]
    if len(points) == 0:
        half = np.max(robot.solid_size[i]) * np.ones(3)
        points = np.stack([half, -half])
    T = robot.solid_pose[i]
    return points @ T[:3, :3].T + T[:3, 3]


def least_gap(exact: ExactRobot, answer: Approach, boards: list[Box]) -> float:
    """Return the smallest exact distance on dense samples of an approach [m]."""
    ready = obstacles_of(boards)
    legs = zip(answer.path[:-1], answer.path[1:], strict=True)
    qs = [q for a, b in legs for q in np.linspace(a, b, _SAMPLES)]
    return min(exact.distance(q, ready).distance for q in qs)


def largest_gap(
    planner: ReactivePlanner, exact: ExactRobot, T: np.ndarray, boards: list[Box]
) -> float:
    """Return the largest exact distance of configurations that reach a pose [m].

    Of many, drawn with inverse kinematics, that are free of what stands still; it may
    be a little less than the largest of all.
    """
    robot, ready = planner.robot, obstacles_of(boards)
    rng, best = np.random.default_rng(0), 0.0
    for _ in range(_SEEDS):
        for solution in robot.ik(T, q_seed=rng.uniform(robot.lower, robot.upper)):
            if planner.static.motion_free(solution.q, np.zeros(robot.dof)):
                best = max(best, exact.distance(solution.q, ready).distance)
    return best
